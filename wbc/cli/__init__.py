"""The command line. Each command imports what it needs when it runs, so that help is quick."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from typing import Any

from wbc.cli.interrupt import Interrupts
from wbc.cli.synergy_arguments import add_synergy
from wbc.errors import WbcError

USAGE, FAILED, INTERNAL, INTERRUPTED = 2, 1, 70, 130

_SCENARIO = "a scenario file, or the name of one that travels with wbc (see: wbc list)"


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    0 success; 1 a run that ended without success; 2 bad input; 70 a fault of wbc itself;
    130 Ctrl-C; 143 SIGTERM.
    """
    try:
        arguments = parser().parse_args(argv)
        with Interrupts(owns_process=argv is None) as arguments.interrupts:
            code = int(arguments.command(arguments))
            sys.stdout.flush()
        return code
    except WbcError as error:
        _say(str(error))
        return USAGE
    except KeyboardInterrupt as stop:
        _say("interrupted")
        return 128 + int(stop.args[0]) if stop.args else INTERRUPTED
    except BrokenPipeError:
        _close_stdout()  # the reader, e.g. head, has seen enough
        return 128 + 13
    except OSError as error:
        if os.environ.get("WBC_DEBUG"):
            raise
        _close_stdout()
        _say(f"wbc: {error}")
        return FAILED
    except Exception as error:
        if os.environ.get("WBC_DEBUG"):
            raise
        what = " ".join(str(error).split())[:200]
        _say(
            f"wbc: internal error, please report it: {type(error).__name__}: {what} "
            "(WBC_DEBUG=1 shows the traceback)"
        )
        return INTERNAL


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _close_stdout() -> None:
    """Let Python's own flush at exit go nowhere instead of failing once more."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def parser() -> argparse.ArgumentParser:
    """The commands and their arguments."""
    top = argparse.ArgumentParser(
        prog="wbc", description="Whole-body control for robots with two arms and dexterous hands."
    )
    top.add_argument(
        "--version", action=_Version, nargs=0, help="print the versions of wbc, pin and Python"
    )
    commands = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_run(commands)
    _add_sweep(commands)
    _add_check(commands)
    _add_view(commands)
    _add_plot(commands)
    _add_robot(commands)
    _add_assemble(commands)
    _add_forces(commands)
    add_synergy(commands, _later, _add_view_options)
    _add(commands, "list", "list the scenarios and robots that travel with wbc", "catalog")
    _add(commands, "schema", "print the JSON Schema of scenario files, for editors", "catalog")
    return top


def _add(commands: Any, name: str, text: str, module: str) -> argparse.ArgumentParser:
    """A command that ``NAME_command`` of a module of this package carries out when it is called."""
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    command.set_defaults(command=_later(f"wbc.cli.{module}", f"{name}_command"))
    return command


def _add_run(commands: Any) -> None:
    text = "run a scenario, write DIR/log.npz and DIR/summary.json"
    run = _add(commands, "run", text, "run")
    run.add_argument("scenario", metavar="NAME_OR_FILE", help=_SCENARIO)
    run.add_argument(
        "--out", metavar="DIR", help="folder of the results (default: runs/NAME, after the file)"
    )
    _add_settings(run)
    run.add_argument("--view", action="store_true", help="follow the run in a browser")
    _add_view_options(run)
    pace = run.add_mutually_exclusive_group()
    pace.add_argument(
        "--realtime", action="store_true", help="at the pace of the clock (default with --view)"
    )
    pace.add_argument("--fast", action="store_true", help="as fast as it goes (default without)")


def _add_sweep(commands: Any) -> None:
    text = "many trials of a scenario, each by its own seed: DIR/trials.jsonl, DIR/report.html"
    sweep = _add(commands, "sweep", text, "sweep")
    sweep.add_argument("scenario", metavar="NAME_OR_FILE", help=_SCENARIO)
    sweep.add_argument("--trials", type=_count, default=100, metavar="N", help="(default: 100)")
    where = sweep.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=_count, metavar="W", help="processes at a time (default: one per core)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="of dask.distributed, e.g. tcp://127.0.0.1:8786"
    )
    sweep.add_argument(
        "--out", metavar="DIR", help="folder of the results, resumed if it has some of this "
        "campaign (default: sweeps/NAME)",
    )  # fmt: skip
    _add_settings(sweep)
    sweep.add_argument(
        "--vary", action="append", default=[], metavar="KEY=RANGE",
        help="draw a value of the scenario from itself ± RANGE, in its unit or in %%, "
        "e.g. --vary object.pose.position[0]=2cm (repeatable)",
    )  # fmt: skip
    sweep.add_argument(
        "--keep", choices=("failed", "all", "none"), default="failed",
        help="whose logs stay in DIR/trials/NNNN, for wbc view and wbc plot (default: failed)",
    )  # fmt: skip


def _add_check(commands: Any) -> None:
    text = "check a scenario without running it: robot, collision pairs, grasps, start"
    check = _add(commands, "check", text, "check")
    check.add_argument("scenario", metavar="NAME_OR_FILE", help=_SCENARIO)
    _add_settings(check)


def _add_view(commands: Any) -> None:
    text = "show a finished run again, in a browser or as one self-contained HTML file"
    view = _add(commands, "view", text, "replay")
    view.add_argument("run", metavar="RUN", help="folder of a run, or its log.npz")
    view.add_argument("--html", metavar="FILE", help="write FILE instead of opening a browser")
    view.add_argument("--rate", type=_rate, default=1.0, metavar="X", help="times real time")
    _add_view_options(view)


def _add_plot(commands: Any) -> None:
    text = "draw a run: object error, residuals, tasks, stack, motion, and a strip of pictures"
    plot = _add(commands, "plot", text, "replay")
    plot.add_argument("run", metavar="DIR", help="folder of a run, or its log.npz")
    plot.add_argument("--out", metavar="DIR2", help="folder of the pictures (default: DIR/plots)")


def _add_robot(commands: Any) -> None:
    text = "show a robot's joints, the links at its ends, and its bodies"
    robot = _add(commands, "robot", text, "robot")
    robot.add_argument(
        "robot", metavar="ROBOT", help="a URDF, a file of parts, package://NAME/..., or a name"
    )


def _add_assemble(commands: Any) -> None:
    text = "make one URDF of several, e.g. a hand on an arm"
    assemble = _add(commands, "assemble", text, "assemble")
    assemble.add_argument("parts", metavar="PARTS.yaml", help="the parts and where each goes")
    assemble.add_argument("out", metavar="OUT.urdf", help="the file to write")


def _add_forces(commands: Any) -> None:
    text = "solve one grasp force problem: how hard each contact must press"
    forces = _add(commands, "forces", text, "forces")
    forces.add_argument(
        "problem", metavar="PROBLEM.npz",
        help="arrays G (6,M), J (M,l), tau_e, tau_min, tau_max (l,), mu (n,), h_e (6,); for soft "
        "fingers mu_t (n,) and model; see docs/forces.md",
    )  # fmt: skip
    forces.add_argument("--out", metavar="RESULT.npz", required=True, help="the file to write")
    forces.add_argument(
        "--method", default="newton", metavar="METHOD",
        help="newton (default), exact, or a flow of the chapter: flow18, flow19, flow20",
    )  # fmt: skip


def _add_settings(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="settings",
        help="replace a value of the file, e.g. --set simulation.duration=2s (repeatable)",
    )  # fmt: skip
    command.add_argument("--seed", metavar="N", help="the same as --set simulation.seed=N")


def _add_view_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--no-browser", action="store_true", help="print the address only")
    command.add_argument("--port", type=_port, metavar="N", help="first port to try (default 7000)")


def _port(text: str) -> int:
    number = int(text) if text.isdecimal() and len(text) < 6 else 0
    if not 0 < number < 65536:
        raise argparse.ArgumentTypeError(f"'{text}' is no port: 1 to 65535")
    return number


def _count(text: str) -> int:
    number = int(text) if text.isdecimal() and len(text) < 8 else 0
    if not number:
        raise argparse.ArgumentTypeError(f"'{text}' is no number of them: 1 to 9999999")
    return number


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 1e-3 <= rate <= 1e3:
        raise argparse.ArgumentTypeError(f"'{text}' is no rate: 0.001 to 1000")
    return rate


def _later(module: str, name: str) -> Any:
    """The command `name` of a module that is imported when it is called."""

    def command(arguments: argparse.Namespace) -> Any:
        import importlib

        return getattr(importlib.import_module(module), name)(arguments)

    return command


class _Version(argparse.Action):
    """Prints the versions; looked up only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from wbc.cli.catalog import version_text

        print(version_text())
        parser.exit()

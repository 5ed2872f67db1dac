"""The arguments of ``wbc synergy``. Imports nothing of weight, so that help is quick."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, TypeAlias

DEFAULT_HAND = "dexmart_hand_right"
_Add: TypeAlias = Callable[[str, str, str], argparse.ArgumentParser]
_RANGES = "a robot with these joints, to know their ranges"


def add_synergy(
    commands: Any, later: Callable[[str, str], Any], view: Callable[[Any], None]
) -> None:
    """Add the command and those below it.

    Args:
        later: makes a command of a module's name and a function's name in it.
        view: adds the options of a live view.
    """
    text = "postural synergies: a hand's shape in a few numbers"
    synergy = commands.add_parser("synergy", help=text, description=text)
    below = synergy.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def add(name: str, module: str, text: str) -> argparse.ArgumentParser:
        command: argparse.ArgumentParser = below.add_parser(name, help=text, description=text)
        command.set_defaults(command=later(f"wbc.cli.synergy_{module}", f"{name}_command"))
        return command

    _add_use(add, view)
    _add_sources(add)
    tables = add("tables", "tables", "what the published tables say and imply, as JSON and CSV")
    _add_out(tables, "DIR")
    pictures = add(
        "pictures", "pictures", "draw the synergies, their ranges, and all published grasps"
    )
    _add_synergies(pictures)
    _add_hand(pictures)
    _add_out(pictures, "DIR")


def _add_use(add: _Add, view: Callable[[Any], None]) -> None:
    """What is done with synergies: weights of postures, a hand in motion."""
    project = add(
        "project", "files", "the weights of recorded postures, and how well they give them back"
    )
    project.add_argument(
        "postures", metavar="POSTURE.csv",
        help="a column for each joint, a row for each posture; radians, or a line '# unit: deg'",
    )  # fmt: skip
    _add_unit(project)
    _add_synergies(project)

    grasp = add("grasp", "motion", "the reach to grasp: from the zero offset, open, close")
    grasp.add_argument(
        "grasp", metavar="GRASP",
        help="C1 to C36, G1 to G5, open, zero_offset; weights in deg, as 75.9,19.8,-68 (after -- "
        "where the first is negative); or POSTURE.csv, with :NAME for one of several rows",
    )  # fmt: skip
    grasp.add_argument(
        "--path", choices=("linear", "smooth"), default="linear",
        help="of the weights over the 3 s of each part: linear (default) or minimum jerk",
    )  # fmt: skip
    _add_unit(grasp)
    _add_motion(grasp, view)

    show = add("show", "motion", "what one synergy does: its least weight, its largest, and back")
    show.add_argument("synergy", metavar="SYNERGY", help="e1, e2, ...")
    _add_motion(show, view)


def _add_sources(add: _Add) -> None:
    """Where synergies come from: postures, files of others."""
    fit = add("fit", "files", "find the synergies of recorded postures and save them")
    fit.add_argument("postures", metavar="POSTURES.csv", help="as for project")
    _add_unit(fit)
    fit.add_argument("--count", type=int, default=3, metavar="K", help="how many (default 3)")
    _add_hand(fit, None, _RANGES)
    _add_out(fit, "FILE.json")

    read = add("import", "files", "save the eigengrasps of a GraspIt! file as synergies")
    read.add_argument("file", metavar="EIGENGRASPS.xml")
    read.add_argument(
        "--joints", required=True, metavar="A,B,...",
        help="names of the hand's joints in the order of GraspIt!'s degrees of freedom",
    )  # fmt: skip
    _add_hand(read, None, _RANGES)
    _add_out(read, "FILE.json")


def _add_unit(command: argparse.ArgumentParser) -> None:
    command.add_argument("--unit", choices=("rad", "deg"), help="of the angles in the file")


def _add_synergies(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--synergies", metavar="FILE.json", help="of another hand (default: the published ones)"
    )


def _add_hand(
    command: argparse.ArgumentParser,
    default: str | None = DEFAULT_HAND,
    text: str = f"its robot (default: {DEFAULT_HAND})",
) -> None:
    command.add_argument("--hand", metavar="URDF", default=default, help=text)
    command.add_argument(
        "--prefix", default="", help="of the joints' names in the robot, e.g. right_"
    )


def _add_motion(command: argparse.ArgumentParser, view: Callable[[Any], None]) -> None:
    _add_synergies(command)
    _add_hand(command)
    command.add_argument("--view", action="store_true", help="follow the hand in a browser")
    view(command)
    command.add_argument(
        "--out", metavar="DIR", help="folder of the run's log (default: runs/synergy_ and its name)"
    )


def _add_out(command: argparse.ArgumentParser, what: str) -> None:
    command.add_argument("--out", metavar=what, required=True, help="what to write")

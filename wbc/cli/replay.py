"""``wbc view`` and ``wbc plot``: a finished run shown again."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from dataclasses import replace as changed
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np

from wbc.cli.as_measured import as_measured
from wbc.cli.pictures import force_pictures, with_table
from wbc.cli.progress import SlowNotice
from wbc.cli.session import LOG, ROBOT
from wbc.contact.grasp import Grasp
from wbc.errors import WbcError
from wbc.recording import Log
from wbc.recording.dynamic_facts import object_error_true
from wbc.robot.model import RobotModel, load_robot
from wbc.scenario import Scenario, load
from wbc.scenario.build import build_grasp
from wbc.scenario.build_tasks import tip_frames
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot
from wbc.view import LiveView, Scene, Snapshot, replay
from wbc.view.forces import ArrowMaker
from wbc.view.from_robot import SnapshotMaker, event_text, robot_scene

_FPS = 60.0  # of a replay: more is not seen
_PICTURES = 6
_WAIT = 30.0  # for a browser to open the page, [s]


def view_command(arguments: argparse.Namespace) -> int:
    """Replay in a browser until Ctrl-C, or write one HTML file."""
    if arguments.html is not None and arguments.rate != 1.0:
        raise WbcError("--rate is for the replay in a browser; the HTML file plays in real time")
    arguments.interrupts.check()
    film = open_film(arguments.run)
    snapshots = list(film.snapshots(film.thinned(_FPS / arguments.rate)))
    if arguments.html is not None:
        from wbc.view import write_html

        path = write_html(arguments.html, film.scene, snapshots)
        print(f"written: {path}")
        return 0
    with (
        contextlib.suppress(KeyboardInterrupt),
        LiveView(film.scene, arguments.port, not arguments.no_browser) as live,
    ):
        if not live.alive:
            raise WbcError(live.warning() or "the live view could not be started")
        print(f"live view: {live.url} (Ctrl-C ends it)", flush=True)
        replay(film.scene, snapshots, arguments.rate, view=live, wait=_WAIT, repeat=True)
        if line := live.warning():
            print(line, file=sys.stderr)
    return 0


def plot_command(arguments: argparse.Namespace) -> int:
    """Every plot of the run, and the strip of pictures."""
    film = open_film(arguments.run)
    from wbc.recording.plots import plot
    from wbc.recording.strip import draw_strip, moments

    folder = Path(arguments.out) if arguments.out else film.path.parent / "plots"
    files = plot(film.measured, folder)
    if film.log.plans_forces:
        files += _force_figures(film, folder)
    instants = list(film.snapshots(moments(film.log, _PICTURES).tolist()))
    files.append(draw_strip(film.scene, instants, folder / "strip.png"))
    print(f"written to {folder}: {', '.join(file.name for file in files)}")
    return 0


def _force_figures(film: Film, folder: Path) -> list[Path]:
    """Figures 4 to 10 of the chapter, for which ticks of the run are solved again."""
    from wbc.cli.force_study import force_study
    from wbc.recording.force_figures import plot_study

    with SlowNotice(lambda line: print(line, file=sys.stderr)):
        study = force_study(film.log, film.scenario, film.model, film.grasp)
    return [] if study is None else plot_study(film.log, study, folder)


@final
@dataclass(frozen=True)
class Film:
    """A run with what it takes to draw it.

    Attributes:
        path: the log's file.
        arrows: where the run has forces.
    """

    path: Path
    log: Log
    scenario: Scenario
    scene: Scene
    model: RobotModel
    grasp: Grasp
    arrows: ArrowMaker | None

    @cached_property
    def shown(self) -> Log:
        """The log with robot and object where they were, also where torques moved them.

        The object's error is then the true one, whichever finger is asked.
        """
        log = self.log
        if not log.dynamic:
            return log
        error = np.stack(object_error_true(log), axis=1)[:, None, :]
        log = changed(log, object_error=np.broadcast_to(error, log.object_error.shape))
        if not np.isfinite(log.q_meas).all():
            return log
        return changed(log, q=log.q_meas, object_pose=log.object_pose_true)

    @cached_property
    def measured(self) -> Log:
        """The log with errors, residuals and tasks as measured, where torques moved the robot."""
        if not (self.log.dynamic and self.log.contact_names):
            return self.log
        return as_measured(self.log, self.scenario, self.model, self.grasp)

    def thinned(self, fps: float) -> list[int]:
        """Ticks for at most `fps` pictures per second, with the first and the last."""
        frame = np.floor((self.log.t - self.log.t[0]) * fps + 1e-6)
        kept: list[int] = np.flatnonzero(np.diff(frame, prepend=-1.0) > 0.0).tolist()
        return kept if kept[-1] == self.log.ticks - 1 else [*kept, self.log.ticks - 1]

    def snapshots(self, ticks: Sequence[int]) -> Iterator[Snapshot]:
        """The run at the given ticks, in order, with the last stack event before each."""
        log, maker = self.log, SnapshotMaker(self.model, arrows=self.arrows)
        told = 0
        for k in ticks:
            while told < len(log.event_t) and log.event_t[told] <= log.t[k]:
                name = log.all_task_names[log.event_task[told]]
                maker.text = event_text(log.event_t[told], name, bool(log.event_inserted[told]))
                told += 1
            yield maker.of_row(self.shown, int(k))


def open_film(run: str) -> Film:
    """A run's log and its scene.

    Args:
        run: the folder of a run, or its log.

    Raises:
        WbcError: no such run, nothing in it, or its robot is not to be found.
    """
    path = Path(run)
    path = path / LOG if path.is_dir() else path
    if not path.exists():
        raise WbcError(f"no run at '{run}': there is no {path} (wbc run writes one)")
    log = Log.load(path)
    if not log.ticks:
        raise WbcError(f"'{path}' holds no tick: there is nothing to show")
    scenario = _scenario(log)
    model = _robot(path.parent, log, scenario)
    if model.joint_names != log.joint_names:
        raise WbcError(f"'{path}' was recorded with another robot than {model.path}")
    grasp = build_grasp(scenario, model)
    _check_contacts(path, log, grasp)
    meta = log.meta
    forces = force_pictures(scenario, meta, model, grasp)
    scene = robot_scene(
        model,
        grasp,
        title=meta.scenario,
        tips=tip_frames(scenario, grasp),
        task_names=log.task_names,
        phase_names=log.phase_names,
        shown=[(log.q[0], log.object_pose[0, :3]), (log.q[-1], log.object_pose[-1, :3])],
        friction=forces.friction,
        measured=forces.measured,
    )
    scene = with_table(scene, scenario, grasp)
    return Film(path, log, scenario, scene, model, grasp, forces.arrows)


def _check_contacts(path: Path, log: Log, grasp: Grasp) -> None:
    if grasp.fingers != log.contact_names:
        raise WbcError(f"'{path}': its contacts are not those of its own scenario")


def _scenario(log: Log) -> Scenario:
    """The scenario as it was run: the log carries its text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.yaml"
        path.write_text(log.meta.scenario_text, encoding="utf-8")
        try:
            return load(path).scenario
        except WbcError as error:
            first = str(error).splitlines()[0].replace(str(path), log.meta.scenario)
            raise WbcError(f"the log's own scenario cannot be read: {first}") from None


def _robot(folder: Path, log: Log, scenario: Scenario) -> RobotModel:
    """The robot as it was run: the copy kept beside the log, else the one the scenario names."""
    kept = folder / ROBOT
    try:
        original = read_robot(robot_file(scenario.robot.urdf, Path(log.meta.source).parent))
    except WbcError:
        return load_robot(kept)
    if kept.is_file() and original.text.encode() != kept.read_bytes():
        return load_robot(kept)  # changed since; while it was not, its meshes are found beside it
    return original

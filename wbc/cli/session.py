"""From the command line's arguments to a scenario ready to run, and where its results go."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from wbc import resources
from wbc.control.controller import Controller
from wbc.control.plan import Fault
from wbc.errors import WbcError
from wbc.forces import POINT, SOFT_FINGER
from wbc.recording import RunMeta
from wbc.scenario import Loaded, load
from wbc.scenario.build import Assembly
from wbc.scenario.build_costs import safety_distance
from wbc.scenario.schema import Scenario
from wbc.scenario.wording import KeyPath
from wbc.sim.dynamic import Dynamics

LOG, SUMMARY, SCENARIO, ROBOT = "log.npz", "summary.json", "scenario.yaml", "robot.urdf"
"""Files of a run's folder."""

_PAGE = 4096
_UNITS = {
    "object_pose": "m",
    "equilibrium_force": "1",
    "equilibrium_moment": "m",
    "palm_distance": "m",
    "frame_position": "m",
    "frame_orientation": "rad",
    "frame_pose": "m, rad",
    "relative_pose": "m, rad",
    "posture": "rad",
    "synergy": "rad",
    "center_of_mass": "m",
}


def load_with_settings(arguments: argparse.Namespace) -> Loaded:
    """The scenario that the arguments name, with their ``--set`` and ``--seed`` on top."""
    return load(arguments.scenario, overrides(arguments.settings, arguments.seed))


def overrides(settings: list[str], seed: str | None) -> dict[str, str]:
    """``KEY=VALUE`` texts as a table.

    Raises:
        WbcError: one line per text that is no setting, or that sets a key a second time.
    """
    table: dict[str, str] = {}
    faults = []
    asked = [*settings, *([] if seed is None else [f"simulation.seed={seed}"])]
    for text in asked:
        key, sign, value = text.partition("=")
        key = key.strip()
        if not sign or not key:
            faults.append(f"--set '{text}': write KEY=VALUE, e.g. simulation.duration=2s")
        elif key in table:
            faults.append(f"--set '{text}': '{key}' is set twice")
        table[key] = value
    if faults:
        raise WbcError("\n".join(faults))
    return table


def as_run(loaded: Loaded) -> str:
    """The text of the scenario as it is run: the file's own, or with what was set in it."""
    if not loaded.overrides:
        return loaded.text
    said = ", ".join(f"{key}={value}" for key, value in loaded.overrides.items())
    # JSON is YAML too, and leaves no doubt which values are text.
    data = json.dumps(loaded.source.located.data, indent=1, ensure_ascii=False)
    return f"# {loaded.scenario.name}, set: {' '.join(said.split())}\n{data}\n"


def source_of(loaded: Loaded) -> str:
    """Where the scenario came from, the same from every working folder."""
    path = loaded.path.resolve()
    if path.parent == resources.folder("tasks").resolve():
        return path.stem
    return str(path)


def run_meta(assembly: Assembly, dynamics: Dynamics | None = None) -> RunMeta:
    """Names, limits and origin of a run; `dynamics` where torques move the robot."""
    loaded, model, controller = assembly.loaded, assembly.model, assembly.controller
    scenario, settings = loaded.scenario, controller.settings
    cut = len(controller.task_names) - controller.law.kin.grasp.count
    secondary = controller.task_names[:cut]
    names = secondary if assembly.main_task is None else (assembly.main_task, *secondary)
    return RunMeta(
        **(_of_torques(dynamics) | _of_forces(controller)),
        scenario=scenario.name,
        dt=settings.dt,
        joint_names=model.joint_names,
        contact_names=controller.law.kin.grasp.fingers,
        task_names=secondary,
        tip_task_names=controller.task_names[cut:],
        main_task=assembly.main_task,
        phase_names=tuple(phase.name for phase in controller.phases.phases),
        scenario_text=as_run(loaded),
        source=source_of(loaded),
        seed=scenario.simulation.seed,
        q_lower=tuple(settings.lower.tolist()),
        q_upper=tuple(settings.upper.tolist()),
        v_limit=tuple(settings.velocity.tolist()),
        task_units=tuple(_unit(scenario, name, model.planar) for name in names),
        remove_above=scenario.supervisor.remove_above,
        insert_below=scenario.supervisor.insert_below,
        safety_distance=safety_distance(scenario),
    )


def _of_forces(controller: Controller) -> dict[str, Any]:
    """What of the planned forces is the same in all ticks; nothing where none are planned."""
    if controller.planner is None:
        return {}
    given = controller.planner.settings
    model = SOFT_FINGER if given.soft else POINT
    return {
        "tau_min": tuple(given.tau_min.tolist()),
        "tau_max": tuple(given.tau_max.tolist()),
        "mu": tuple(given.mu.tolist()),
        "mu_t": tuple(given.mu_t.tolist()),
        "contact_models": (model,) * len(given.mu),
    }


def _of_torques(dynamics: Dynamics | None) -> dict[str, Any]:
    """Torque limits of the second stage; nothing on the ideal robot."""
    if dynamics is None:
        return {}
    gains = dynamics.second.gains
    return {"tau_min": tuple(gains.tau_min.tolist()), "tau_max": tuple(gains.tau_max.tolist())}


def _unit(scenario: Scenario, task: str, planar: bool) -> str:
    spec: Any = scenario.tasks[task]
    if spec.type == "manipulability":
        return "m²" if planar else "m³"
    return _UNITS.get(spec.type, "")


def fault_lines(loaded: Loaded, faults: Iterable[Fault]) -> list[str]:
    """What a rehearsal found, a line each, with the place in the file that is to be changed."""
    places: dict[str, KeyPath] = {"start": ("robot", "start"), "object": ("object", "pose")}
    lines = []
    for fault in faults:
        path = places.get(fault.about, ("phases", fault.phase or 0))
        if fault.about == "contact" and fault.finger is not None:
            path = ("contacts", fault.finger, "at")
        lines.append(f"{loaded.locate(path)}: {fault.text}")
    return lines


def results_folder(asked: str | None, scenario: str) -> Path:
    """The folder of a run's results, made and found writable before the run.

    Raises:
        WbcError: it cannot be made or written to.
    """
    folder = Path(asked) if asked else Path("runs") / file_name(scenario)
    try:
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(20, "it is not a folder")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_PAGE))
            file.flush()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise WbcError(f"cannot write to '{folder}': {reason} (choose a folder by --out)") from None
    for name in (LOG, SUMMARY, SCENARIO, ROBOT):
        if (folder / name).is_dir():
            raise WbcError(
                f"cannot write to '{folder / name}': it is a folder (choose another --out)"
            )
    return folder


def file_name(scenario: str) -> str:
    """The scenario's name without what a file system could take for something else."""
    kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in scenario)
    return kept.strip(".")[:80] or "run"

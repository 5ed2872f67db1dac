"""An arm in space whose fingertip slides on an object that stays where it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from conformance.robots import hand_urdf

from wbc.control.state import ControllerState, TickRecord
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import load_robot
from wbc.scenario import load
from wbc.scenario.build import SURFACES, Assembly, build

REACH = 5e-3
START = 0.4  # [rad], every joint: well bent, far from limits


class Slide(NamedTuple):
    """A run of the controller: the states at the start of every tick and after the last."""

    assembly: Assembly
    records: list[TickRecord]
    states: list[ControllerState]

    @property
    def v(self) -> np.ndarray:
        return np.array([record.v for record in self.records])

    @property
    def xi(self) -> np.ndarray:
        """(T + 1, 2) of the finger."""
        return np.array([state.contact.xi[0] for state in self.states])

    @property
    def face(self) -> np.ndarray:
        return np.array([state.contact.face[0] for state in self.states])

    @property
    def points(self) -> np.ndarray:
        """(T + 1, 3) contact points in the object frame."""
        surface = self.assembly.controller.law.kin.grasp.surface
        return np.array(
            [surface.point(s.contact.xi[0], int(s.contact.face[0])) for s in self.states]
        )

    @property
    def object_error(self) -> float:
        return float(np.nanmax([record.object_error for record in self.records]))


def assemble(
    folder: Path, surface: dict[str, Any], at: Sequence[float], face: str, goal: Sequence[float],
    *, overrides: dict[str, Any] | None = None, gain: float = 4.0,
) -> Assembly:  # fmt: skip
    """Finger a touches at `at` and is pulled to the point `goal` of the object frame, [m]."""
    (folder / "hand.urdf").write_text(hand_urdf(prismatic=False))
    model = load_robot(folder / "hand.urdf")
    sizes = {key: value for key, value in surface.items() if key != "type"}
    body = SURFACES[surface["type"]](**sizes)
    index = body.face_index(face)
    kin = Kinematics(model, ("tip_a",)).update(np.full(model.nv, START))
    # where the surface is smooth its level's gradient is the normal
    start = body.point(np.array(at), index)
    normal = body.level_gradient(start * (1.0 + 1e-9))
    place = kin.position[0] - start - REACH * normal
    units = ["rad" if "poles" in face or face == "side" else "m",
             "rad" if "poles" in face else "m"]  # fmt: skip
    scenario = {
        "name": "slide",
        "robot": {
            "urdf": "hand.urdf",
            "fingers": {"a": "tip_a"},
            "start": {name: f"{START} rad" for name in model.joint_names},
        },
        "object": {"surface": surface, "pose": {"position": place.tolist()}},
        "contacts": {"a": {
            "at": [f"{x} {unit}" for x, unit in zip(at, units, strict=True)],
            "face": face, "rest_length": REACH,
        }},
        "tasks": {
            "object": {"type": "object_pose", "gain": "20 /s"},
            "pull": {"type": "frame_position", "frame": "tip_a", "gain": f"{gain} /s",
                     "target": (place + np.array(goal)).tolist(), "saturation": 0.03},
        },
        "stack": {"priority": ["object", "pull"]},
        "phases": [{"name": "slide", "contacts": {"a": "sliding"}, "tasks": ["pull"]}],
        "simulation": {"duration": "3 s", "step": "2 ms"},
    }  # fmt: skip
    path = folder / "slide.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return build(load(path, overrides=overrides))


def run(assembly: Assembly, ticks: int | None = None) -> Slide:
    state, records = assembly.start, []
    states = [state]
    for _ in range(assembly.ticks if ticks is None else ticks):
        record, state = assembly.controller.step(state)
        records.append(record)
        states.append(state)
    return Slide(assembly, records, states)

"""A hand that holds a soap by three fingertips from the first tick on, and plans its forces."""

from __future__ import annotations

from typing import Any

from wbc.scenario import load
from wbc.scenario.build import Assembly, build

START = {  # of the soap's scenario, where its hand is when it begins to lift
    "torso_yaw": 2.2, "torso_pitch_1": -21.7, "torso_pitch_2": 37.6, "right_arm_1": -26.8,
    "right_arm_2": -61.7, "right_arm_3": -6.3, "right_arm_4": 81.9, "right_arm_5": 51.3,
    "right_arm_6": -55.5, "right_arm_7": -8.1, "right_index_abd": -8.7, "right_index_prox": -1.0,
    "right_index_med": 55.4, "right_middle_abd": -9.2, "right_middle_prox": 27.2,
    "right_middle_med": 52.3, "right_thumb_abd": -16.4, "right_thumb_prox": 29.8,
    "right_thumb_med": 58.6,
}  # fmt: skip
AT = {"r_thumb": -0.22224, "r_index": 2.26171, "r_middle": -2.78547}  # [rad] on the equator
LIFT = {
    "name": "lift", "contacts": {"r_*": "fixed"}, "tasks": [], "over": "0.1 s",
    "object": {
        "target": {"position": [0, 0, "1 cm"], "rpy": ["10 deg", 0, "5 deg"]}, "relative": True,
    },
    "until": {"time": "0.1 s"},
}  # fmt: skip


def holding(
    *, phases: list[dict[str, Any]] | None = None, mass: str = "30 g", **changes: Any
) -> Assembly:
    """The soap, held; `changes` are overrides with __ for dots."""
    overrides = {
        "robot.start": {name: f"{angle} deg" for name, angle in START.items()},
        "phases": phases or [LIFT],
        "simulation.rehearse": False,
        "object.mass": mass,
        "object.com": [0, "2 mm", "1 mm"],
        "object.inertia": ["2e-5 kg m^2", "2e-5 kg m^2", "2e-5 kg m^2"],
        "forces": {"friction": 0.7},
        "costs": {},
        **{f"contacts.{name}.at": [f"{at} rad", 0] for name, at in AT.items()},
        **{name.replace("__", "."): value for name, value in changes.items()},
    }
    return build(load("soap", overrides))

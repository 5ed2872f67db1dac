"""Check of the gains of arm joints: that there are such joints."""

from __future__ import annotations

from typing import Final

from wbc.control.force_control import finger_joints
from wbc.robot.model import RobotModel
from wbc.scenario.blocks import EVERY
from wbc.scenario.patterns import matching
from wbc.scenario.schema import Scenario
from wbc.scenario.wording import Fault, Faults, KeyPath, clip

_INSTEAD: Final = {
    "stiffness": "they are held by 'force_control.position'",
    "damping": "theirs is 'force_control.damping'",
}


def check_arms(scenario: Scenario, model: RobotModel, tips: tuple[str, ...]) -> list[Fault]:
    """Faults of keys under `force_control.arms` that fit joints of fingers only.

    A key that fits both is of the arms' joints; what nobody wrote is no fault.

    Args:
        tips: frames of the fingertips, as in `finger_joints`.
    """
    faults, second = Faults([]), scenario.force_control
    if second is None:
        return []
    own = finger_joints(model, tips)
    fingers = {name for name, is_own in zip(model.joint_names, own, strict=True) if is_own}
    remedy = "name joints of the arms" if len(fingers) < model.nv else "remove it"
    for kind, given in (("stiffness", second.arms.stiffness), ("damping", second.arms.damping)):
        table: KeyPath = ("force_control", "arms", kind)
        for key in given if kind in second.arms.model_fields_set else ():
            found = [key] if key in model.joint_names else matching([key], model.joint_names)
            if not found or not fingers.issuperset(found):
                continue
            text = f"fits only joints of fingers, which carry one fingertip as '{clip(found[0])}' "
            text += f"does: {_INSTEAD[kind]}; {remedy}"
            if key == EVERY:
                faults.add(table, text)
            else:
                faults.add((*table, key), text, on="key")
    return faults.found

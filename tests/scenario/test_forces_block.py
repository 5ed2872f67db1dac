"""The weight of the object, its contents, and the forces block: what is read, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.errors import ScenarioError
from wbc.forces.problem import W_BF, W_BT, W_P
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_forces import torque_limits, value_for

Lines = Callable[..., list[str]]

TEXT = """\
name: pour
robot:
  urdf: dual_arm
  fingers: {r_thumb: right_thumb_tip, r_index: right_index_tip, r_middle: right_middle_tip}
object:
  surface: {type: cylinder, radius: 35 mm, length: 20 cm}
  pose: {position: [0.6, 0, 0.6]}
  mass: 0.2 kg
  com: [0, 0, 1 cm]
  inertia: [1e-3 kg m^2, 1e-3 kg m^2, 2e-4 kg m^2]
  contents: {type: water, mass: 225 g, pours: {phase: empty, to: 25 g}}
contacts:
  r_thumb: {at: [0, 0]}
  r_index: {at: [120 deg, 0]}
  r_middle: {at: [-120 deg, 0]}
tasks:
  main: {type: object_pose, gain: 20 /s}
stack: {priority: [main]}
phases:
  - name: turn
    contacts: {'*': fixed}
    over: 0.8 s
    until: {time: 0.8 s}
  - name: empty
    contacts: {'*': fixed}
    over: 0.4 s
    until: {time: 0.4 s}
forces:
  friction: {'*': 0.6, r_thumb: 0.8}
  torque_limits: {'*_thumb_*': 0.5 Nm, 'right_*_med': 75 mNm, 'torso_*': off}
  margin: 0.02
simulation: {duration: 1 s, step: 2 ms}
"""

# The text to replace, its replacement with § where the fault is to be reported, the words.
FAULTS = [
    ("mass: 0.2 kg", "mass: §0.2 N", "object.mass: must be a mass such as '0.2 kg', got a force, "
     "'0.2 N'"),
    ("mass: 0.2 kg", "mass: §0 kg", "object.mass: must be above 0, got '0 kg'"),
    ("[1e-3 kg m^2, 1e-3 kg m^2, 2e-4 kg m^2]", "§[1e-3, 1e-3]", "object.inertia: must have 3 "
     "entries, got 2"),
    ("[1e-3 kg m^2, 1e-3 kg m^2, 2e-4 kg m^2]", "§[2e-4, 1e-3, 2e-4]", "object.inertia: no body "
     "has these moments: none is above the sum of the other two"),
    ("type: water", "type: §wine", "object.contents.type: must be water, got 'wine'"),
    ("contents: {type: water, ", "§contents: {", "missing key 'type' in object.contents"),
    ("mass: 225 g", "mass: §2 kg", "object.contents.mass: is 2 l, more than the 0.7697 l inside"),
    ("mass: 225 g", "mass: 225 g, radius: 3 cm, §lenght: 1 cm",
     "unknown key 'lenght' (did you mean 'length'?)"),
    ("phase: empty", "phase: §emtpy", "unknown phase 'emtpy' (did you mean 'empty'?)"),
    ("to: 25 g", "to: §1 kg", "object.contents.pours.to: must be at most the mass that is inside, "
     "0.225 kg"),
    ("friction: {'*': 0.6, r_thumb: 0.8}", "friction: §-1", "forces.friction: must be above 0, got "
     "-1"),
    ("friction: {'*': 0.6, r_thumb: 0.8}", "friction: {'*': 0.6, r_thumb: §0}",
     "forces.friction.r_thumb: must be above 0, got 0"),
    ("friction: {'*': 0.6, r_thumb: 0.8}", "friction: {'*': 0.6, §r_tumb: 0.8}",
     "unknown contact 'r_tumb' (did you mean 'r_thumb'?)"),
    ("friction: {'*': 0.6, r_thumb: 0.8}", "friction: §{r_thumb: 0.8}", "forces.friction: says "
     "nothing of 'r_index': '*' stands for all the others"),
    ("friction: {'*': 0.6, r_thumb: 0.8}", "friktion: 0.6", None),
    ("margin: 0.02", "margin: §0.8", "forces.margin: must be at most 0.5, got 0.8"),
    ("margin: 0.02", "method: §newtown", "forces.method: must be newton or exact, got 'newtown' "
     "(did you mean 'newton'?)"),
    ("'*_thumb_*': 0.5 Nm", "'*_thumb_*': §-0.5 Nm", "forces.torque_limits.*_thumb_*: must be "
     "above 0, got '-0.5 Nm'"),
    ("'*_thumb_*': 0.5 Nm", "'*_thumb_*': §0.5 kNm", "forces.torque_limits.*_thumb_*: unknown "
     "unit 'kNm' (did you mean 'Nm'?) (or 'off')"),
]  # fmt: skip


def place(text: str) -> str:
    before = text[: text.index("§")]
    return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


@pytest.mark.parametrize(("old", "new", "words"), FAULTS)
def test_each_fault_has_its_place_and_its_words(
    faults: Lines, old: str, new: str, words: str | None
) -> None:
    assert TEXT.count(old) == 1
    found = [
        line.removeprefix("t.yaml:") for line in faults(TEXT.replace(old, new.replace("§", "")))
    ]
    if words is None:
        assert found == ["29:3: unknown key 'friktion' (did you mean 'friction'?)"]
        return
    assert found == [f"{place(TEXT.replace(old, new))}: {words}"]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("  mass: 0.2 kg\n", "", "27:1: forces: needs 'mass' in the block 'object'"),
        ("mass: 0.2 kg", "mass: null", "28:1: forces: needs 'mass' in the block 'object'"),
        ("  margin: 0.02", "  torsion: 4 mm", "31:3: forces.torsion: is only of soft fingers: "
         "'model' is not soft_finger"),
        ("    over: 0.4 s\n", "", "11:55: object.contents.pours.phase: phase 'empty' has no "
         "'over', the time in which it would leave"),
        ("{type: cylinder, radius: 35 mm, length: 20 cm}", "{type: sphere, radius: 35 mm}",
         "11:3: object.contents: needs 'length' of the room inside: the surface is no cylinder"),
        ("  margin: 0.02", "  model: soft_finger", "28:1: forces: needs 'torsion' for soft "
         "fingers"),
        ("  margin: 0.02", "  model: soft_finger\n  torsion: {r_t*: 4 mm}", "32:12: "
         "forces.torsion: says nothing of 'r_index': '*' stands for all the others"),
    ],
)  # fmt: skip
def test_what_goes_together(faults: Lines, old: str, new: str, line: str) -> None:
    assert TEXT.count(old) == 1
    assert f"t.yaml:{line}" in faults(TEXT.replace(old, new))


def test_it_loads_without_a_fault(faults: Lines) -> None:
    assert faults(TEXT) == []


def test_a_planar_object_takes_no_forces(faults: Lines) -> None:
    from .hold import COMPLETE

    text = COMPLETE.replace("angle: 90 deg}\n", "angle: 90 deg}\n  mass: 1 kg\n", 1)
    assert "t.yaml:32:1: forces: are planned in space: the object lies in the plane" in faults(
        text + "forces: {friction: 0.5}\n"
    )


@pytest.fixture
def loaded(tmp_path: Path) -> Callable[..., Any]:
    def loader(**overrides: Any) -> Any:
        path = tmp_path / "pour.yaml"
        path.write_text(TEXT)
        return load(path, {name.replace("__", "."): value for name, value in overrides.items()})

    return loader


def test_one_number_stands_for_all_contacts(loaded: Callable[..., Any]) -> None:
    assert loaded(forces__friction=0.5).scenario.forces.friction == {"*": 0.5}


def test_the_weights_are_the_solvers_own(loaded: Callable[..., Any]) -> None:
    forces = loaded().scenario.forces
    assert (forces.w_p, forces.w_bF, forces.w_bT) == (W_P, W_BF, W_BT)


def test_a_contact_in_full_comes_before_patterns_and_these_in_their_order() -> None:
    given = {"r_*": 0.3, "*_thumb": 0.9, "r_index": 0.5}
    assert [value_for(given, name) for name in ("r_thumb", "r_index", "l_thumb")] == [0.3, 0.5, 0.9]
    assert np.isnan(value_for(given, "l_index"))


def test_torque_limits_by_pattern_else_the_robots_own(loaded: Callable[..., Any]) -> None:
    from wbc.resources import find
    from wbc.robot.model import load_robot

    model = load_robot(find("urdf", "dual_arm"))
    limit = torque_limits(loaded().scenario.forces.torque_limits, model)
    known = dict(zip(model.joint_names, limit, strict=True))
    assert known["left_thumb_abd"] == 0.5 and known["right_index_med"] == 0.075
    assert np.isinf(known["torso_yaw"]) and known["right_arm_1"] == 176.0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("right_thum_med", "unknown joint 'right_thum_med' (did you mean 'right_thumb_med'?)"),
        ("*_elbow", "unknown joint '*_elbow'"),
        ("right_index_dist", "joint 'right_index_dist' follows 'right_index_med' (mimic)"),
    ],
)
def test_joints_that_the_robot_does_not_have(
    loaded: Callable[..., Any], name: str, words: str
) -> None:
    with pytest.raises(ScenarioError) as fault:
        build(loaded(forces__torque_limits={name: 0.5}))
    assert words in str(fault.value) and len(str(fault.value).splitlines()) == 1

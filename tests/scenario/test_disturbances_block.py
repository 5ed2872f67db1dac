"""`simulation.disturbances`: units and bounds of each quantity, and what the block needs."""

from __future__ import annotations

import math
from typing import Any

import pytest

from wbc.errors import ScenarioError
from wbc.scenario import load
from wbc.scenario.build_disturbance import ranges_of
from wbc.scenario.disturbance_blocks import Disturbances, check_disturbances
from wbc.scenario.wording import Faults
from wbc.sim.disturbances import Lost, Push, Ranges

WHOLE = {
    "mass": "30 %", "friction": 0.3, "size": "1 %", "position": "5 mm", "rotation": "2 deg",
    "gravity": "5 %", "force_noise": "5 %", "force_floor": "20 mN", "joint_noise": "0.2 mrad",
    "velocity_noise": "1 deg/s", "delay": "3 ms", "dropout": "1 %",
    "pushes": [{"at": "3 s", "force": ["-1 N", 0, "0 N"], "over": "50 ms"}],
    "lost": [{"finger": "f1", "at": "4 s", "over": "0.1 s"}],
}  # fmt: skip


def test_every_quantity_in_its_unit() -> None:
    assert ranges_of(Disturbances.model_validate(WHOLE)) == Ranges(
        mass=0.3, friction=0.3, size=0.01, position=0.005, rotation=math.radians(2.0),
        gravity=0.05, force_noise=0.05, force_floor=0.02, joint_noise=2e-4,
        velocity_noise=math.radians(1.0), delay=0.003, dropout=0.01,
        pushes=(Push(3.0, (-1.0, 0.0, 0.0), 0.05),), lost=(Lost("f1", 4.0, 0.1),),
    )  # fmt: skip


def test_an_empty_block_disturbs_nothing() -> None:
    assert ranges_of(Disturbances.model_validate({})) == Ranges()


def faults_of(**given: Any) -> str:
    with pytest.raises(ScenarioError) as error:
        load("planar_exchange", {"simulation.disturbances": given})
    return str(error.value)


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("mass", "100 %", "mass: must be at most 0.95"),
        ("mass", "-1 %", "mass: must be at least 0"),
        ("mass", "30 mm", "mass: must be a share such as '30 %', got a length"),
        ("friction", ".nan", "friction: must be a share"),
        ("position", "-5 mm", "position: must be at least 0"),
        ("rotation", 2, "rotation: an angle needs its unit"),
        ("rotation", "200 deg", "rotation: must be at most 3.14159"),
        ("dropout", "101 %", "dropout: must be at most 1"),
        ("delay", "3 mm", "delay: must be a time"),
        ("pushes", [{"at": "3 s", "force": ["1 N"], "over": "1 ms"}], "must have 3 entries, got 1"),
        ("pushes", [{"at": "3 s", "force": ["1 N", 0, 0]}], "missing key 'over'"),
        ("lost", [{"finger": "f9", "at": 1, "over": 1}], "unknown contact 'f9' (known: f1"),
        ("lost", [{"finger": "f1", "at": 1, "over": 0}], "lost[0].over: must be above 0"),
        ("frction", "3 %", "unknown key 'frction' (did you mean 'friction'?)"),
    ],
)  # fmt: skip
def test_a_bad_value_is_one_line(key: str, value: Any, why: str) -> None:
    lines = faults_of(**{key: value}).splitlines()
    assert sum(why in line for line in lines) == 1, lines


def test_an_ideal_robot_cannot_be_disturbed() -> None:
    assert "needs 'simulation.engine: compliant or mujoco'" in faults_of(mass="3 %")


@pytest.mark.parametrize("engine", ["compliant", "mujoco"])
def test_an_engine_with_forces_can(engine: str) -> None:
    faults = Faults()
    data = {
        "simulation": {"engine": engine, "disturbances": WHOLE},
        "object": {},
        "contacts": {"f1": {}},
    }
    check_disturbances(data, faults)
    assert not faults.found


def test_without_an_object_there_is_nothing_to_disturb() -> None:
    faults = Faults()
    check_disturbances({"simulation": {"engine": "compliant", "disturbances": {}}}, faults)
    assert [fault.text for fault in faults.found] == ["needs a block 'object'"]

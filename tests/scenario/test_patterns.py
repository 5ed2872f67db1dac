"""A name with a star stands for every finger it fits; faults still say where they are."""

from __future__ import annotations

import pytest

from wbc.errors import ScenarioError
from wbc.scenario import load
from wbc.scenario.patterns import matching

from .hold import COMPLETE


def scenario(tmp_path, **changes):
    text = COMPLETE
    for old, new in changes.values():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / "hold.yaml"
    path.write_text(text)
    return path


HOLD = "    contacts: {f1: fixed, f2: fixed}\n"


def test_names_in_the_order_of_the_patterns_each_once():
    assert matching(["b*", "*"], ["a1", "b1", "b2"]) == ("b1", "b2", "a1")
    assert matching(["c*"], ["a1"]) == ()


def test_a_star_stands_for_every_finger(tmp_path):
    path = scenario(tmp_path, hold=(HOLD, "    contacts: {'f*': fixed}\n"))
    assert load(path).scenario.phases[0].contacts == {"f1": "fixed", "f2": "fixed"}


def test_a_finger_named_in_full_wins_wherever_it_stands(tmp_path):
    path = scenario(tmp_path, hold=(HOLD, "    contacts: {'*': fixed, f2: sliding}\n"))
    assert load(path).scenario.phases[0].contacts == {"f1": "fixed", "f2": "sliding"}
    loaded = load(path, {"phases.hold.contacts.f1": "sliding"})
    assert loaded.scenario.phases[0].contacts == {"f1": "sliding", "f2": "sliding"}


def test_each_finger_gets_a_value_of_its_own(tmp_path):
    reach = "    reach: {f2: {clearance: 1 cm}}\n"
    path = scenario(
        tmp_path,
        held=("    contacts: {f1: fixed}\n", ""),
        reach=(reach, "    reach: {'*': {clearance: 1 cm, offset: [0, 1 cm, 0]}}\n"),
    )
    goals = load(path).scenario.phases[1].reach
    assert {name: (goal.clearance, tuple(goal.offset)) for name, goal in goals.items()} == {
        "f1": (0.01, (0.0, 0.01, 0.0)), "f2": (0.01, (0.0, 0.01, 0.0)),
    }  # fmt: skip


def test_faults_are_told_where_the_pattern_stands(tmp_path):
    path = scenario(tmp_path, hold=(HOLD, "    contacts: {'f*': glued}\n"))
    line = COMPLETE[: COMPLETE.index(HOLD)].count("\n") + 1
    with pytest.raises(ScenarioError, match=f"hold.yaml:{line}:22: phases"):
        load(path)
    path = scenario(tmp_path, hold=(HOLD, "    contacts: {'g*': fixed}\n"))
    with pytest.raises(ScenarioError, match=rf"hold.yaml:{line}:16: unknown finger 'g\*'"):
        load(path)

"""Synergy tasks in a scenario: what they come to, and every fault with its place and remedy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from wbc.cli import main
from wbc.errors import ScenarioError
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.synergies import Synergies, weights_of
from wbc.tasks import Synergy

Write = Callable[[str | bytes], Path]

TEXT = """\
name: shape
robot: {urdf: dual_arm, start: {right_index_med: 40 deg}}
tasks:
  right: {type: synergy, prefix: right_, gain: 5 /s}
  rest: {type: posture, gain: 1 /s}
stack: {priority: [right, rest]}
phases:
  - name: pen
    tasks: [right, rest]
    weights: {right: C27}
    over: 1 s
    until: {time: 1 s}
simulation: {duration: 2 s, step: 2 ms}
"""
HAND = Synergies.from_table()
LED = "weights: {right: C27}"
TASK = "right: {type: synergy, prefix: right_, gain: 5 /s}"


def built(write: Write, text: str) -> Assembly:
    return build(load(write(text)))


def lines(write: Write, text: str) -> list[str]:
    """The faults of a text, without the file's name; none if it is built."""
    try:
        built(write, text)
    except ScenarioError as error:
        return [line.removeprefix("t.yaml:") for line in str(error).splitlines()]
    return []


def task_of(assembly: Assembly) -> Synergy:
    task = assembly.controller.law.stack.tasks[0]
    assert isinstance(task, Synergy)
    return task


# The text to replace, its replacement with a caret where the fault is to be reported, the words.
FAULTS = [
    # the phase
    ("{right: C27}", "{^left: C27}", "unknown task 'left' (known: right, rest)"),
    ("{right: C27}", "{^rest: C27}", "phases[0].weights.rest: is of type posture: only a synergy "
     "task has weights"),
    ("tasks: [right, rest]\n    weights: {", "tasks: [rest]\n    weights: {^",
     "phases[0].weights.right: is not among this phase's tasks: add it there"),
    ("weights: {right: C27}\n    over: 1 s\n", "^weights: {right: C27}\n",
     "phases[0].weights: needs 'over' in this phase, the duration of the motion"),
    ("{right: C27}", "^C27", "phases[0].weights: must be a mapping, got 'C27'"),
    # weights
    ("right: C27", "right: ^C72", "unknown weights 'C72' (did you mean 'C7'?)"),
    ("right: C27", "right: ^opne", "unknown weights 'opne' (did you mean 'open'?)"),
    ("right: C27", "right: ^''", "phases[0].weights.right: must not be empty"),
    ("right: C27", "right: ^3", "phases[0].weights.right: must be a list, got 3"),
    ("right: C27", "right: [1 deg, ^2, 0]", "phases[0].weights.right[1]: an angle needs its unit: "
     "write '110 deg' or '1.92 rad'"),
    ("right: C27", "right: ^[1 deg, 2 deg]", "phases[0].weights.right: must be 3 weights, one for "
     "each synergy, got 2"),
    ("right: C27", "right: ^[200 deg, 0, 0]", "phases[0].weights.right: take joint "
     "'right_little_med' to 136.4 deg, 41.4 deg beyond its limit 95 deg, 6 more beyond theirs "
     "(give smaller ones, or measure: posture, which stops there)"),
    ("right: C27", "right: ^[0, 0, -100 deg]", "phases[0].weights.right: take joint "
     "'right_thumb_med' to -35.21 deg, 5.21 deg beyond its limit -30 deg "
     "(give smaller ones, or measure: posture, which stops there)"),
    (TASK, "right: {type: synergy, prefix: right_, weights: ^[1 deg], gain: 5 /s}",
     "tasks.right.weights: must be 3 weights, one for each synergy, got 1"),
    (TASK, "right: {type: synergy, prefix: right_, weights: [^1 m, 0, 0], gain: 5 /s}",
     "tasks.right.weights[0]: must be an angle such as '110 deg', got a length, '1 m'"),
    # the task
    (TASK, "right: {type: synergy, prefix: right_, measure: ^weight, gain: 5 /s}",
     "tasks.right.measure: must be weights, outside or posture, got 'weight' "
     "(did you mean 'weights'?)"),
    (TASK, "right: {type: synergy, prefix: right_, path: ^straight, gain: 5 /s}",
     "tasks.right.path: must be smooth or linear, got 'straight'"),
    (TASK, "right: {type: synergy, ^prefixes: right_, gain: 5 /s}",
     "unknown key 'prefixes' (did you mean 'prefix'?)"),
    (TASK, "right: {type: synergy, prefix: ^rigth_, gain: 5 /s}",
     "tasks.right.prefix: the robot has none of the synergies' joints, 'rigth_thumb_abd' and so on "
     "(did you mean prefix: left_ or right_?)"),
    (TASK, "right: ^{type: synergy, gain: 5 /s}",
     "tasks.right.synergies: the robot has none of the synergies' joints, 'thumb_abd' and so on "
     "(did you mean prefix: left_ or right_?)"),
    (TASK, "right: {type: synergy, synergies: ^dexmrat, prefix: right_, gain: 5 /s}",
     "tasks.right.synergies: no such file, and no synergies of that name: 'dexmrat' "
     "(did you mean 'dexmart'?)"),
    (TASK, "right: {type: synergy, synergies: ^hand.jso, prefix: right_, gain: 5 /s}",
     "tasks.right.synergies: no such file, and no synergies of that name: 'hand.jso' "
     "(did you mean 'hand.json'?)"),
    (TASK, "right: {type: synergy, synergies: ^7, prefix: right_, gain: 5 /s}",
     "tasks.right.synergies: must be text, got 7: write '7'"),
    (TASK, "right: {type: synergy, synergies: hand.json, prefix: right_, weights: ^C1, gain: 5 /s}",
     "unknown weights 'C1' (known: open, zero_offset)"),
    (TASK, "right: {type: synergy, synergies: odd.json, prefix: ^right_, gain: 5 /s}",
     "unknown joint 'right_index_mid' (did you mean 'right_index_med'?)"),
    (TASK, "right: {type: synergy, synergies: dist.json, prefix: ^right_, gain: 5 /s}",
     "tasks.right.prefix: joint 'right_index_dist' follows 'right_index_med' (mimic) and has no "
     "value of its own: name 'right_index_med'"),
    (TASK, "right: {type: synergy, synergies: far.json, prefix: ^right_, gain: 5 /s}",
     "tasks.right.prefix: the range of joint 'right_index_med' in the synergies lies outside its "
     "limits in the robot (are they of another hand?)"),
]  # fmt: skip


@pytest.fixture
def files(write: Write, tmp_path: Path) -> Write:
    """As `write`, with files of synergies beside the scenario."""
    HAND.save(tmp_path / "hand.json")
    med = HAND.joints.index("index_med")

    def renamed(name: str) -> Synergies:
        names = (*HAND.joints[:med], name, *HAND.joints[med + 1 :])
        return replace(HAND, joints=names)

    renamed("index_mid").save(tmp_path / "odd.json")
    renamed("index_dist").save(tmp_path / "dist.json")
    upper, lower = np.array(HAND.upper), np.array(HAND.lower)
    upper[med], lower[med] = 4.0, 3.0
    replace(HAND, upper=upper, lower=lower).save(tmp_path / "far.json")
    return write


@pytest.mark.parametrize(("old", "new", "words"), FAULTS, ids=[words for *_, words in FAULTS])
def test_every_fault_has_its_place_and_words(files: Write, old: str, new: str, words: str) -> None:
    assert TEXT.count(old) == 1
    text = TEXT.replace(old, new)
    if ".json" in new:  # of which no grasps are known by name
        text = text.replace("C27", "open")
    before = text[: text.index("^")]
    place = f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
    assert lines(files, text.replace("^", "")) == [f"{place}: {words}"]


def test_what_is_outside_has_no_weights(files: Write) -> None:
    outside = TASK.replace("gain", "measure: outside, gain")
    assert lines(files, TEXT.replace(TASK, outside)) == [
        "10:15: phases[0].weights.right: measures what is outside the synergies: it has no weights"
    ]
    text = TEXT.replace(TASK, outside.replace("gain", "weights: C1, gain")).replace(LED, "")
    assert lines(files, text) == [
        "4:60: tasks.right.weights: are not for measure: outside, which only brings the hand into "
        "the synergies"
    ]
    assert not lines(files, TEXT.replace(TASK, outside).replace(f"    {LED}\n", ""))


def test_a_file_that_is_no_synergies_is_refused_in_one_line(files: Write, tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text("{", encoding="utf-8")
    text = TEXT.replace(TASK, TASK.replace("gain", "synergies: bad.json, gain"))
    [line] = lines(files, text)
    assert line.startswith("4:53: tasks.right.synergies: bad.json:")


def test_synergies_of_every_joint_leave_nothing_outside(files: Write, tmp_path: Path) -> None:
    whole = Synergies(
        ("index_prox", "index_med"), np.zeros(2), np.eye(2), np.ones(2), 2.0, np.zeros(2),
        np.ones(2),
    )  # fmt: skip
    whole.save(tmp_path / "two.json")
    text = TEXT.replace(TASK, TASK.replace("gain", "synergies: two.json, measure: outside, gain"))
    assert lines(files, text.replace(f"    {LED}\n", "")) == [
        "4:72: tasks.right.measure: 2 synergies span all joints: nothing is outside them"
    ]


def test_posture_takes_weights_that_leave_the_limits(files: Write) -> None:
    text = TEXT.replace(TASK, TASK.replace("gain", "measure: posture, gain"))
    assert not lines(files, text.replace("C27", "[200 deg, 0, 0]"))


def test_a_posture_keeps_to_the_robots_limits_where_the_synergies_know_none(
    files: Write, tmp_path: Path
) -> None:
    unknown = np.full(15, np.inf)
    replace(HAND, lower=-unknown, upper=unknown).save(tmp_path / "free.json")
    text = TEXT.replace(TASK, TASK.replace("gain", "synergies: free.json, measure: posture, gain"))
    assembly = built(files, text.replace("C27", "open"))
    task, model = task_of(assembly), assembly.model
    assert_array_equal(task.lower, model.lower[task.joints])
    assert_array_equal(task.upper, model.upper[task.joints])


def test_without_weights_the_hand_stays_where_it_starts(files: Write) -> None:
    assembly = built(files, TEXT)
    task = task_of(assembly)
    names = [f"right_{joint}" for joint in HAND.joints]
    assert [assembly.model.joint_names[k] for k in task.joints] == names
    assert_allclose(task.goal, HAND.project(assembly.start.q[task.joints]), atol=1e-15)
    assert_array_equal(assembly.controller.phases.phases[0].task_motions[0].goal, weights_of("C27"))


@pytest.mark.parametrize(
    ("given", "want"),
    [
        ("open", HAND.project(np.zeros(15))), ("zero_offset", np.zeros(3)),
        ("G5", weights_of("G5")), ("[10 deg, 0, -0.1 rad]", [np.deg2rad(10.0), 0.0, -0.1]),
    ],
)  # fmt: skip
def test_weights_by_name_and_by_number(files: Write, given: str, want: np.ndarray) -> None:
    assembly = built(files, TEXT.replace(TASK, TASK.replace("gain", f"weights: {given}, gain")))
    assert_allclose(task_of(assembly).goal, want, atol=1e-15)
    assert_allclose(assembly.start.targets[0], weights_of("C27"))  # the first phase leads it there


def test_a_file_is_the_same_hand(files: Write) -> None:
    table, file = (
        task_of(built(files, TEXT.replace(TASK, TASK.replace("gain", f"synergies: {name}, gain"))
                      .replace("C27", "open")))
        for name in ("dexmart", "hand.json")
    )  # fmt: skip
    for field in ("joints", "mean", "basis", "lower", "upper", "goal"):
        assert_array_equal(getattr(table, field), getattr(file, field))


def test_the_goal_and_the_law_are_set_from_outside() -> None:
    """What `wbc run synergy_reach --set phases.close.weights.shape=G3` does."""
    assembly = build(
        load("synergy_reach", {"phases.close.weights.shape": "G3", "tasks.shape.path": "smooth"})
    )
    [motion] = assembly.controller.phases.phases[1].task_motions
    assert_array_equal(motion.goal, weights_of("G3"))
    assert not motion.linear
    with pytest.raises(ScenarioError, match=r"^--set phases.close.weights.shape: unknown weights"):
        build(load("synergy_reach", {"phases.close.weights.shape": "G9"}))


def test_check_says_where_a_phase_leads_a_hand(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "synergy_reach"]) == 0
    out = capsys.readouterr().out
    assert "leads shape to -133.4, 3.492, -5.871 deg" in out
    assert "leads shape to 75.9, 19.8, -68 deg" in out and "ready to run" in out
    assert "clipped to the hand's ranges: thumb_abd +3.5 deg, thumb_med -5.3 deg" in out
    free = ["tasks.shape.measure=weights", "phases.close.weights.shape=C34"]
    assert main(["check", "synergy_reach", *(f"--set={setting}" for setting in free)]) == 0
    out = capsys.readouterr().out
    assert "warning: leaves the hand's ranges: thumb_med -23.3 deg, little_med -0.3 deg (" in out

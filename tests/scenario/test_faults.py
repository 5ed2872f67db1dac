"""Every class of fault: where it is reported, and in which words."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from .hold import COMPLETE

Broken = Callable[[str, str], list[str]]
Lines = Callable[..., list[str]]

# The text to replace, its replacement with a caret where the fault is to be reported, the words.
ONE_FAULT = [
    # keys
    ("  urdf: planar", "  ^udrf: planar", "unknown key 'udrf' (did you mean 'urdf'?)"),
    ("at: [0]", "at: [0], ^mu: -1", "unknown key 'mu' (known: at, face, stiffness, rest_length, "
     "force, share)"),
    ("at: [0]", "at: [0], share: ^0", "contacts.f1.share: must be above 0, got 0"),
    ("robot:\n  urdf: planar_bimanual\n", "^robot:\n", "missing key 'urdf' in robot"),
    ("main: {type: object_pose, gain: 50 /s}", "^main: {type: object_pose}",
     "missing key 'gain' in tasks.main"),
    ("- name: lift\n    contacts", "- ^contacts", "missing key 'name' in phases[1]"),
    ("name: hold\nrobot", "name: hold\n^name: again\nrobot", "duplicate key 'name' "
     "(first on line 1)"),
    ("name: hold\nrobot", "name: hold\n^3: 4\nrobot", "a key must be text: write '3'"),
    ("wrist: {type", "^7wrist: {type", "tasks.7wrist: '7wrist' is no name: use letters, digits, _ "
     "and -, a letter first"),
    # types
    ("object_pose", "^object_posse", "unknown task type 'object_posse' "
     "(did you mean 'object_pose'?)"),
    ("circle", "^cirle", "unknown surface type 'cirle' (did you mean 'circle'?)"),
    ("joint_limits", "^joint_limit", "unknown cost type 'joint_limit' "
     "(did you mean 'joint_limits'?)"),
    ("type: circle", "type: ^3", "object.surface.type: must be the type of a surface, got 3"),
    ("soft: {type: joint_limits, ", "^soft: {", "missing key 'type' in costs.soft "
     "(known: collision, joint_limits)"),
    # quantities
    ("j1: 10 deg", "j1: ^10", "robot.start.j1: an angle needs its unit: write '110 deg' or "
     "'1.92 rad' (a length: '5 mm')"),
    ("90 deg}\ncontacts", "^90}\ncontacts", "object.pose.angle: an angle needs its unit: write "
     "'110 deg' or '1.92 rad'"),
    ("radius: 10 cm", "radius: ^10 s", "object.surface.radius: must be a length such as '5 mm', "
     "got a time, '10 s'"),
    ("radius: 10 cm", "radius: ^10 mmm", "object.surface.radius: unknown unit 'mmm' "
     "(did you mean 'mm'?)"),
    ("radius: 10 cm", "radius: ^-10 cm", "object.surface.radius: must be above 0, got '-10 cm'"),
    ("radius: 10 cm", "radius: ^ten", "object.surface.radius: must be a length such as '5 mm', "
     "got 'ten'"),
    ("radius: 10 cm", "radius: ^.nan", "object.surface.radius: must be a finite number, got nan"),
    ("radius: 10 cm", "radius: ^-.inf", "object.surface.radius: must be a finite number, got -inf"),
    ("radius: 10 cm", "radius: ^1e999 m", "object.surface.radius: must be a finite number, got "
     "'1e999 m'"),
    ("radius: 10 cm", "radius: ^1" + "0" * 400, "object.surface.radius: must be a finite number, "
     "got inf"),
    ("50 /s", "^true", "tasks.main.gain: must be a rate such as '20 /s', got true"),
    ("50 /s", "^~", "tasks.main.gain: must be a rate such as '20 /s', got nothing"),
    ("50 /s", "^0", "tasks.main.gain: must be above 0, got 0"),
    ("delta: 2", "delta: ^2 rad", "costs.soft.delta: must be a plain number, got '2 rad'"),
    ("smoothing: 'off'", "smoothing: ^of", "supervisor.smoothing: must be a rate such as '20 /s', "
     "got 'of' (or 'off')"),
    # other values
    ("urdf: planar_bimanual", "urdf: ^7", "robot.urdf: must be text, got 7: write '7'"),
    ("then: stop", "then: ^stpo", "phases[0].timeout.then: must be stop, next or hold, got 'stpo' "
     "(did you mean 'stop'?)"),
    ("relative: true", "relative: ^yes", "phases[1].object.relative: must be true or false, got "
     "'yes'"),
    ("step: 2 ms", "step: 2 ms, seed: ^1.5", "simulation.seed: must be a whole number, got 1.5"),
    ("step: 2 ms", "step: 2 ms, seed: ^-1", "simulation.seed: must be at least 0 and below 2^63, "
     "got -1"),
    ("[0, 0.5]", "^[0]", "object.pose.position: must have 2 or 3 entries, got 1"),
    ("[1, 2 cm, 0]", "^[1, 2 cm]", "tasks.wrist.target: must have 3 entries, got 2"),
    ("[1, 2 cm, 0]", "^5", "tasks.wrist.target: must be a list, got 5"),
    ("[x, y]", "[x, ^w]", "tasks.wrist.axes[1]: must be x, y or z, got 'w'"),
    ("[main, wrist]}", "^[]}", "stack.priority: must have at least 1 entry, got 0"),
    ("{j1: 10 deg, j2: 5 cm}", "^[1]", "robot.start: must be a mapping, got a list of 1"),
    ("f2: tip_2", "f2: ^''", "robot.fingers.f2: must not be empty"),
    # relations inside a block
    ("insert_below: 0.02", "insert_below: ^0.2", "supervisor.insert_below: insert_below (0.2) must "
     "be below remove_above (0.05)"),
    ("step: 2 ms", "step: ^4 s", "simulation.step: must not be longer than the duration"),
    ("step: 2 ms", "step: ^1e-9", "simulation.step: makes more than 10000000 ticks of the "
     "duration"),
    ("lower: -110 deg", "lower: ^110 deg", "costs.soft.lower: the lower limit of j1 must be below "
     "the upper one"),
    ("after: 2 s", "after: ^1 s", "phases[0].timeout.after: comes no later than until.time, so the "
     "phase cannot succeed"),
    ("    over: 1 s\n", "    over: 1 s\n    timeout: {after: ^0.9 s, then: stop}\n",
     "phases[1].timeout.after: comes before the motions' end ('over'), so the phase cannot "
     "succeed"),
    ("{time: 1 s}", "^{}", "phases[0].until: is empty: give time, residual, tip_error, distance, "
     "force_closure, touch or press"),
    # between blocks
    ("[main, wrist]", "[main, ^rist]", "unknown task 'rist' (did you mean 'wrist'?)"),
    ("[main, wrist]", "[main, wrist, ^wrist]", "stack.priority[2]: 'wrist' is listed twice"),
    ("[main, wrist]", "[main]", ""),
    ("tasks: [wrist]", "tasks: [^writs]", "unknown task 'writs' (did you mean 'wrist'?)"),
    ("tasks: [wrist]", "tasks: [wrist, ^wrist]", "phases[0].tasks[1]: 'wrist' is listed twice"),
    ("{time: 1 s}", "{residual: {^mian: 1}}", "unknown task 'mian' (did you mean 'main'?)"),
    ("fixed, f2: fixed", "fixed, ^thumb: fixed", "unknown finger 'thumb' (known: f1, f2)"),
    ("reach: {f2:", "reach: {^f1:", "phases[1].reach.f1: is in this phase's contacts and cannot "
     "reach"),
    ("{time: 1 s}", "{time: 1 s, ^tip_error: 1}", "phases[0].until.tip_error: needs a finger in "
     "'reach'"),
    ("    over: 1 s\n", "    over: 1 s\n    force: {^f2: 1 N}\n", "phases[1].force.f2: does not "
     "touch in this phase, so it has no force"),
    ("name: lift", "name: ^hold", "phases[1].name: 'hold' names two phases"),
    ("at: [0]", "at: ^[0, 0]", "contacts.f1.at: a contact on a circle takes an angle, got 2 "
     "values"),
    ("at: [180 deg]", "at: [^2 cm]", "contacts.f2.at[0]: must be an angle here on a circle, not "
     "a length"),
    ("at: [0]", "at: [0], face: ^1", "contacts.f1.face: must be below 1 on a circle, or one of "
     "contour"),
    ("at: [0]", "at: [0], face: ^side", "unknown face 'side' (known: contour)"),
]  # fmt: skip


def place(text: str) -> str:
    """``line:column`` of the caret in a text."""
    before = text[: text.index("^")]
    return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


@pytest.mark.parametrize(("old", "new", "words"), ONE_FAULT)
def test_each_fault_is_reported_once_with_its_place_and_its_words(
    broken: Broken, old: str, new: str, words: str
) -> None:
    found = broken(old, new.replace("^", ""))
    if not words:
        assert found == ["22:13: phases[0].tasks[0]: 'wrist' is not in stack.priority"]
        return
    expected = f"{place(COMPLETE.replace(old, new))}: {words}"
    # A key that is misspelled where others refer to it is missed there as well.
    also = [line for line in found if line != expected]
    assert expected in found
    assert not also or "wrist: {type" in old, also


def test_the_unbroken_text_loads(faults: Lines) -> None:
    assert faults(COMPLETE) == []


def test_all_faults_at_once_in_the_order_of_the_file(faults: Lines) -> None:
    text = COMPLETE
    for old, new in (
        ("j1: 10 deg", "j1: 10"),
        ("type: circle, radius: 10 cm", "type: cirle, radius: -1, color: red"),
        ("frame: wrist", "frme: wrist"),
        ("then: stop", "then: stpo"),
        ("[main, wrist]", "[main, rist]"),
        ("step: 2 ms", "step: !!python/name:os.system ''"),
        ("  - name: lift", "  - name: lift\n    name: drop"),
    ):
        text = text.replace(old, new)
    found = [line.split(": ", 1)[0].removeprefix("t.yaml:") for line in faults(text)]
    assert found == ["5:15", "7:19", "7:34", "7:38", "14:33", "17:26", "24:33", "26:5", "31:35"]


def test_a_planar_surface_refuses_a_pose_in_space(broken: Broken) -> None:
    assert broken("position: [0, 0.5], angle: 90 deg", "position: [0, 0, 1]") == [
        "8:20: object.pose.position: a circle lies in the plane: give position [x, y] and angle"
    ]


def test_a_surface_in_space_refuses_planar_poses_and_contacts(broken: Broken) -> None:
    assert broken("type: circle", "type: sphere") == [
        "8:20: object.pose.position: a sphere lies in space: give position [x, y, z] and rpy or "
        "quaternion",
        "10:12: contacts.f1.at: a contact on a sphere takes an angle and an angle, got 1 values",
        "11:12: contacts.f2.at: a contact on a sphere takes an angle and an angle, got 1 values",
        "28:33: phases[1].object.target.position: a sphere lies in space: give position "
        "[x, y, z] and rpy or quaternion",
    ]


def test_contacts_need_an_object_and_an_object_pose_first(broken: Broken) -> None:
    start, end = COMPLETE.index("object:\n"), COMPLETE.index("contacts:\n")
    found = broken(COMPLETE[start:end], "")
    assert "6:1: contacts: needs a block 'object'" in found
    assert broken("[main, wrist]", "[wrist, main]") == [
        "17:20: stack.priority[0]: with contacts the first task must be an object_pose, not "
        "frame_position",
        "17:27: stack.priority[1]: 'main' is an object_pose, which can only be first",
    ]


@pytest.mark.parametrize(
    ("old", "new", "most"),
    [("\ntasks:", "\ntaks:", 2), ("\ncontacts:", "\ncontcts:", 4), ("  fingers:", "  fngers:", 2),
     ("\nobject:", "\nobjct:", 3)],
)  # fmt: skip
def test_a_misspelled_block_is_not_missed_line_by_line(
    broken: Broken, old: str, new: str, most: int
) -> None:
    found = broken(old, new)
    wrong = new.strip(" \n:")
    assert any(
        f"unknown key '{wrong}' (did you mean '{old.strip(' :' + chr(10))}'?)" in f for f in found
    )
    assert len(found) <= most, found


def test_a_reach_and_a_motion_need_a_duration(broken: Broken) -> None:
    assert broken("    over: 1 s\n", "") == [
        "27:5: phases[1].reach: needs 'over' in this phase, the duration of the motion",
        "28:5: phases[1].object: needs 'over' in this phase, the duration of the motion",
    ]


def test_a_phase_that_never_ends_is_refused_unless_it_is_the_last(broken: Broken) -> None:
    ending = "    until: {time: 1 s}\n    timeout: {after: 2 s, then: stop}\n"
    assert broken(ending, "") == ["20:5: phases[0]: never ends: give it 'until'"]


@pytest.mark.parametrize(
    ("pose", "line"),
    [
        ("{rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]}", "14:66: tasks.wrist.target.quaternion: "
         "give rpy or quaternion, not both"),
        ("{quaternion: [0, 0, 0, 0]}", "14:62: tasks.wrist.target.quaternion: has no direction: "
         "its norm must be above 1e-9 and finite"),
        ("{quaternion: [0, 0, 1]}", "14:62: tasks.wrist.target.quaternion: must have 4 entries, "
         "got 3"),
        ("{rpy: [0, 0, 3]}", "14:62: tasks.wrist.target.rpy[2]: an angle needs its unit: write "
         "'110 deg' or '1.92 rad'"),
        ("{}", "14:62: tasks.wrist.target: is empty"),
    ],
)  # fmt: skip
def test_rotations(broken: Broken, pose: str, line: str) -> None:
    new = f"{{type: frame_orientation, frame: w, target: {pose}, gain: 5}}"
    found = broken("{type: frame_position, frame: wrist, target: [1, 2 cm, 0], axes: [x, y], "
                   "gain: 5}", new)  # fmt: skip
    what = line.split(": ", 1)[1]
    assert [f.split(": ", 1)[1] for f in found] == [what]
    assert found[0].startswith("14:")


def test_a_thousand_faults_stay_quick_and_readable(faults: Lines) -> None:
    wrong = ", ".join(f"task{i}" for i in range(3000))
    found = faults(COMPLETE.replace("[main, wrist]", f"[main, {wrong}]"))
    assert len(found) == 201
    assert found[-1] == "t.yaml: and 2800 more faults"

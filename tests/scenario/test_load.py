"""Finding a scenario, setting values on top of it, and saying where things are."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wbc import resources
from wbc.errors import ScenarioError
from wbc.scenario import Scenario, check_names, load
from wbc.scenario.kinds import (
    SURFACES,
    FramePositionSpec,
    JointLimitsSpec,
    SurfaceSpec,
    limit_of,
)
from wbc.scenario.wording import Fault

from .hold import COMPLETE

Write = Callable[[str | bytes], Path]
Lines = Callable[..., list[str]]


def test_every_scenario_that_travels_with_the_package_loads_by_name_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "planar_exchange" in resources.names("tasks")
    for name in resources.names("tasks"):
        loaded = load(name)
        assert loaded.scenario.name == name
        assert load(f"{name}.yaml").hash == loaded.hash
        assert load(loaded.path).hash == loaded.hash
        assert loaded.hash == hashlib.sha256(loaded.path.read_bytes()).hexdigest()


def test_the_values_are_in_si(write: Write) -> None:
    scenario = load(write(COMPLETE)).scenario
    assert scenario.robot.start["j1"] == (np.radians(10.0), "angle")
    assert scenario.robot.start["j2"] == (0.05, "length")
    assert scenario.object is not None
    assert scenario.object.surface.planar
    assert scenario.object.pose.xyz == (0.0, 0.5, 0.0)
    assert scenario.object.pose.xyzw == pytest.approx((0.0, 0.0, 0.5**0.5, 0.5**0.5))
    wrist, soft = scenario.tasks["wrist"], scenario.costs["soft"]
    assert isinstance(wrist, FramePositionSpec) and wrist.target == (1.0, 0.02, 0.0)
    assert isinstance(soft, JointLimitsSpec)
    assert limit_of(soft.lower, "j1") == limit_of(soft.lower, "j9") == (np.radians(-110), "angle")
    assert limit_of(soft.upper, "j9") is None
    assert scenario.supervisor.smoothing is None
    assert scenario.phases[1].reach["f2"].clearance == 0.01


def test_what_is_left_out_has_a_default(write: Write) -> None:
    text = "name: still\nrobot: {urdf: a}\ntasks: {p: {type: posture, gain: 5}}\n"
    text += "stack: {priority: [p]}\nsimulation: {duration: 1, step: 0.01}\n"
    scenario = load(write(text)).scenario
    assert scenario.object is None and scenario.phases == () and scenario.costs == {}
    assert scenario.robot.collisions.pairs is None
    assert scenario.limits.velocity_scale == 1.0
    assert scenario.supervisor.insert_below < scenario.supervisor.remove_above
    assert scenario.simulation.integrator == "rk4"


def test_a_scenario_cannot_be_changed(write: Write) -> None:
    loaded = load(write(COMPLETE))
    with pytest.raises(ValueError, match="frozen"):
        loaded.scenario.name = "other"  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        loaded.hash = ""  # type: ignore[misc]


def test_locate(write: Write) -> None:
    loaded = load(write(COMPLETE), {"simulation.step": "1 ms"})
    assert loaded.locate(("tasks", "wrist")) == "t.yaml:14:10"
    assert loaded.locate(("tasks", "wrist"), key=True) == "t.yaml:14:3"
    assert loaded.locate(("phases", 1, "reach", "f2", "clearance")) == "t.yaml:27:29"
    assert loaded.locate(("tasks", "wrist", "saturation")) == "t.yaml:14:10"
    assert loaded.locate(()) == "t.yaml:1:1"
    assert loaded.locate(("simulation", "step")) == "--set simulation.step"
    assert loaded.locate(("simulation", "duration")) == "t.yaml:30:24"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("plannar_exchange", "(did you mean 'planar_exchange'?)"),
        ("t.yml", "t.yml: no such file (did you mean 't.yaml'?)"),
        ("sub/t.yaml", "sub/t.yaml: no such file"),
        ("./s.yaml", "./s.yaml: no such file (did you mean 't.yaml'?)"),
        (".", ".: is a folder, not a scenario"),
        ("", "no scenario: give a file or a name"),
        ("a\0b", "no such file"),
        ("x" * 5000, "no such file"),
        ("a\nb", "a\\nb: no such file"),
        ("~nobody_here/x.yaml", "no such file"),
    ],
)
def test_a_file_that_is_not_there(write: Write, name: str, words: str) -> None:
    write(COMPLETE)
    with pytest.raises(ScenarioError) as error:
        load(name)
    assert words in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_local_file_comes_before_a_name(write: Write) -> None:
    path = write(COMPLETE)
    path.rename(path.with_name("planar_exchange.yaml"))
    assert load("planar_exchange.yaml").scenario.name == "hold"
    assert load("planar_exchange").scenario.name == "planar_exchange"


@pytest.mark.parametrize(
    ("name", "value", "found"),
    [
        ("simulation.step", "1 ms", lambda s: s.simulation.step == 0.001),
        ("simulation.step", 0.001, lambda s: s.simulation.step == 0.001),
        ("simulation.step", np.float64(0.001), lambda s: s.simulation.step == 0.001),
        ("simulation.seed", "7", lambda s: s.simulation.seed == 7),
        ("simulation.seed", np.int64(7), lambda s: s.simulation.seed == 7),
        ("limits.acceleration", "60 rad/s^2", lambda s: s.limits.acceleration == 60.0),
        ("phases.lift.over", "2 s", lambda s: s.phases[1].over == 2.0),
        ("phases[1].over", "2 s", lambda s: s.phases[1].over == 2.0),
        ("phases.1.over", "2 s", lambda s: s.phases[1].over == 2.0),
        ("supervisor.smoothing", "off", lambda s: s.supervisor.smoothing is None),
        ("stack.priority", "[main]", None),
        ("phases.hold.tasks", "[]", lambda s: s.phases[0].tasks == ()),
        ("tasks.wrist.axes", ("x",), lambda s: s.tasks["wrist"].axes == ("x",)),
        ("tasks.extra", {"type": "posture", "gain": 1}, lambda s: s.tasks["extra"].gain == 1.0),
        ("object.pose.position", "[1 cm, 2 cm]", lambda s: s.object.pose.xyz == (0.01, 0.02, 0)),
    ],
)
def test_overrides(
    write: Write, name: str, value: object, found: Callable[[Scenario], bool] | None
) -> None:
    if found is None:
        with pytest.raises(ScenarioError, match=r"22:13: .* is not in stack.priority"):
            load(write(COMPLETE), {name: value})
    else:
        loaded = load(write(COMPLETE), {name: value})
        assert found(loaded.scenario)
        assert loaded.overrides == {name: value}


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("simulation.step", "-1 ms", "must be above 0, got '-1 ms'"),
        ("simulation.stp", "1 ms", "unknown key 'stp' (did you mean 'step'?)"),
        ("simulaton.step", "1 ms", "unknown key 'simulaton' (did you mean 'simulation'?)"),
        ("stack.priority", "[main, rist]", "unknown task 'rist' (did you mean 'wrist'?)"),
        ("phases.lft.over", "1 s", "'lft' is no entry of phases (did you mean 'lift'?)"),
        ("phases.7.over", "1 s", "'7' is no entry of phases (known: hold, lift)"),
        ("simulation.step.x", "1", "simulation.step is '2 ms' and has no entries"),
        ("simulation.step", "{a: 1", "the '{' opened at 1:1 is not closed before this"),
        ("simulation.step", "!!python/name:os ''", "the tag '!!python/name:os' is not allowed: a "
         "scenario is plain data"),
        ("simulation..step", "1", "is no path: write block.key"),
        ("", "1", "is no path: write block.key"),
        ("tasks.wrist", "{type: posture}", "missing key 'gain' in tasks.wrist"),
        ("tasks.wrist.gain", "true", "must be a rate such as '20 /s', got true"),
        ("tasks.wrist.gain", 10**400, "must be a finite number, got 1000"),
        ("tasks.wrist.gain", np.array([1.0]), "must be a rate such as '20 /s', got a list of 1"),
        ("tasks.wrist.gain", object(), "must be a rate such as '20 /s', got <object"),
    ],
)  # fmt: skip
def test_a_fault_in_an_override_is_said_to_be_there(
    write: Write, name: str, value: object, line: str
) -> None:
    with pytest.raises(ScenarioError) as error:
        load(write(COMPLETE), {name: value})
    (found,) = str(error.value).splitlines()
    assert found.startswith(f"--set {name}: {line}")


def test_faults_of_overrides_come_after_those_of_the_file(faults: Lines) -> None:
    found = faults(COMPLETE.replace("then: stop", "then: stpo"), simulation__step="x")
    assert [line.split(":")[0] for line in found] == ["t.yaml", "--set simulation.step"]


def test_an_override_may_mend_the_file(faults: Lines) -> None:
    assert faults(COMPLETE.replace("step: 2 ms", "step: -2"), simulation__step="2 ms") == []


def names(write: Write, text: str) -> list[str]:
    loaded = load(write(text))
    found = check_names(
        loaded.scenario, ["j1", "j2"], ["wrist", "tip_1", "tip_2"], ["hand", "arm"], ["j2"]
    )
    return str(loaded.error(found)).splitlines() if found else []


def test_names_that_only_the_robot_can_judge(write: Write) -> None:
    assert names(write, COMPLETE) == []
    text = COMPLETE
    for old, new in (
        ("f2: tip_2", "f2: ^tip_9"),
        ("j1: 10 deg, j2: 5 cm}", "j1: ^10 cm, ^j3: 0}\n  metric: {^k1: 2}\n"
         "  collisions: {pairs: [[hand, ^am], ^[arm, arm]], ignore: [[hand, object]]}"),
        ("frame: wrist", "frame: ^wirst"),
        ("{j1: 90 deg}", "{j2: ^90 deg}"),
        ("soft:", "near: {type: collision, safety_distance: 1 cm, pairs: [[^x, hand]]}\n  soft:"),
        ("  wrist:", "  rest: {type: posture, gain: 1, joints: [j1, ^jj]}\n  wrist:"),
    ):  # fmt: skip
        text = text.replace(old, new)
    places = [
        f"t.yaml:{number}:{match.start() + 1 - before}: "
        for number, line in enumerate(text.splitlines(), start=1)
        for before, match in enumerate(re.finditer(r"\^", line))
    ]
    words = [
        "unknown frame 'tip_9' (did you mean 'tip_2'?)",
        "robot.start.j1: joint 'j1' takes an angle",
        "unknown joint 'j3' (known: j1, j2)",
        "unknown joint 'k1' (known: j1, j2)",
        "unknown link 'am' (did you mean 'arm'?)",
        "robot.collisions.pairs[1]: pairs a link with itself",
        "unknown joint 'jj' (known: j1, j2)",
        "unknown frame 'wirst' (did you mean 'wrist'?)",
        "unknown link 'x' (known: hand, arm, object)",
        "costs.soft.upper.j2: joint 'j2' takes a length",
    ]
    found = names(write, text.replace("^", ""))
    assert found == [place + what for place, what in zip(places, words, strict=True)]


def test_a_builder_can_report_its_own_faults(write: Write) -> None:
    loaded = load(write(COMPLETE))
    error = loaded.error([Fault(("phases", 1), "cannot start"), Fault(("robot", "urdf"), "gone")])
    assert str(error) == ("t.yaml:3:9: robot.urdf: gone\nt.yaml:25:5: phases[1]: cannot start")


def test_importing_the_room_builds_no_model() -> None:
    code = (
        "import sys, wbc.scenario as s; print(s.Scenario.__pydantic_complete__,"
        " 'numpy' in sys.modules, 'pinocchio' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "False"]


def test_the_surfaces_of_scenarios_are_those_of_contacts() -> None:
    classes = pytest.importorskip("wbc.contact.surfaces").SURFACES
    assert set(SURFACES) == set(classes)
    for name, spec in SURFACES.items():
        assert issubclass(spec, SurfaceSpec)
        assert spec.faces == classes[name].faces
        assert (len(spec.chart) == 1) == classes[name].planar

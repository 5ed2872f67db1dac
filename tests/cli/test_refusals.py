"""What cannot be carried out is refused before motion: who, where, how far, and a remedy."""

from __future__ import annotations

import re
from pathlib import Path

from wbc import resources
from wbc.cli import main

EXCHANGE = resources.find("tasks", "dual_arm_exchange")
TEXT = EXCHANGE.read_text(encoding="utf-8").replace("../urdf", str(resources.folder("urdf")))
LINES = TEXT.splitlines()


def edited(folder: Path, *changes: tuple[str, str]) -> Path:
    """A copy of the exchange with patterns replaced; each must be found."""
    text = TEXT
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    file = folder / "edited.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def refused(capsys, file: Path | str, *settings: str) -> tuple[str, list[str]]:
    """Output and lines of faults of a check that fails as it should."""
    assert main(("check", str(file), *(f"--set={text}" for text in settings))) == 2
    out, errors = capsys.readouterr()
    lines = [line for line in errors.splitlines() if not line.startswith("compiling")]
    assert lines and not any("error" in line or "Traceback" in line for line in lines), lines
    assert all("nan" not in line and "inf " not in line for line in lines), lines
    return out, lines


def line_of(fault: str, file: str) -> str:
    """The line of the scenario that a fault points to."""
    found = re.match(rf"\S*{file}:(\d+):\d+: ", fault)
    assert found, fault
    return LINES[int(found[1]) - 1]


def test_an_object_out_of_reach(capsys):
    out, (fault,) = refused(capsys, "dual_arm_exchange", "object.pose.position=[2.4, 0, 0.60]")
    assert "name: reach" in line_of(fault, "dual_arm_exchange.yaml")
    for finger in ("r_thumb", "r_index", "r_middle"):
        found = re.search(rf"'{finger}' (\d+\.\d) mm", fault)
        assert found and 500.0 < float(found[1]) < 1500.0, fault
    assert "phase 'reach': fingers stop short of where they go" in fault
    assert re.search(r"at a limit: .*torso_pitch_1|its arm is stretched", fault)
    assert fault.endswith("(move the object or the start nearer)")
    assert out.count("not rehearsed: it stops at a fault") == 12


def test_an_object_inside_the_torso(capsys):
    _, faults = refused(capsys, "dual_arm_exchange", "object.pose.position=[0, 0, 0.60]")
    assert "pose:" in line_of(faults[0], "dual_arm_exchange.yaml")
    found = re.search(r"start: 'torso_\w+' and 'object' collide, (\d+\.\d) mm deep", faults[0])
    assert found and float(found[1]) > 10.0
    assert "(move the object" in faults[0]


def test_an_unknown_fingertip(capsys, tmp_path):
    file = edited(tmp_path, ("r_thumb: right_thumb_tip", "r_thumb: right_thumb_tipp"))
    _, (fault,) = refused(capsys, file)
    assert "r_thumb: right_thumb_tip" in line_of(fault, "edited.yaml")
    assert "unknown frame 'right_thumb_tipp' (did you mean 'right_thumb_tip'?)" in fault


def test_a_contact_on_the_wrong_side(capsys, tmp_path):
    file = edited(
        tmp_path, (r"r_thumb: \{at: \[-34 deg, -128 mm\]", "r_thumb: {at: [90 deg, -6 cm]")
    )
    out, (fault,) = refused(capsys, file)
    assert "r_thumb: {at:" in line_of(fault, "edited.yaml")
    assert "phase 'enter': the straight way of finger 'r_thumb' goes through the object" in fault
    found = re.search(r"(\d+\.\d) mm below its surface, (\d+) mm before its end", fault)
    assert found and 5.0 < float(found[1]) < 25.0 and 0.0 < float(found[2]) < 120.0
    assert "(put its contact point on the side it comes from" in fault
    assert "rehearsed: over" not in out


def test_contacts_that_do_not_hold(capsys):
    one_side = ("contacts.r_index.at=[-34 deg, -110 mm]", "contacts.r_middle.at=[-34 deg, -119 mm]")
    _, (fault,) = refused(capsys, "dual_arm_exchange", *one_side)
    assert "r_thumb: {at:" in line_of(fault, "dual_arm_exchange.yaml")
    assert "phase 'lift': 'r_thumb', 'r_index' and 'r_middle' do not hold the object" in fault
    assert "not force closed, whatever the friction (put contact points on opposite" in fault


def test_contacts_that_need_more_friction_than_there_is(capsys):
    near = ("contacts.r_index.at=[-60 deg, -128 mm]", "contacts.r_middle.at=[-10 deg, -128 mm]")
    out, _ = refused(capsys, "dual_arm_exchange", *near)  # the fingers meet too
    (warning,) = (line for line in out.splitlines() if "friction above 2.14" in line)
    assert warning.startswith("warning: ") and "phase 'lift'" in warning


def test_hands_that_would_collide(capsys, tmp_path):
    """The left hand comes to where the right hand is."""
    file = edited(
        tmp_path,
        (
            r"('l_\*': \{clearance: 8 mm, offset: )\[1 cm, -6 cm, 11 cm\]",
            r"\1[1 cm, -10 cm, -6 cm]",
        ),
        (r"(l_\w+: \{at: \[\S+ deg, )", r"\1-"),
    )
    out, (fault,) = refused(capsys, file)
    assert re.search("name: (approach|surround)", line_of(fault, "edited.yaml"))
    found = re.search(r"'(left|right)_\w+' and '(left|right)_\w+' (collide|come as near as)", fault)
    assert found and found[1] != found[2] and " mm" in fault, fault
    assert "(move the contact points or the start apart)" in fault
    assert "rehearsed: over" in out and "rehearsed: failed" in out


def test_a_run_is_refused_before_it_moves(capsys, tmp_path):
    setting = "--set=object.pose.position=[2.4, 0, 0.60]"
    assert main(("run", "dual_arm_exchange", "--fast", setting, f"--out={tmp_path / 'out'}")) == 2
    out, errors = capsys.readouterr()
    assert "phase 'reach': fingers stop short of where they go" in errors
    assert "written to" not in out
    assert not list((tmp_path / "out").iterdir())


def test_objects_that_no_slide_balances(capsys):
    circle = "object.surface={type: circle, radius: 0.43 m}"
    at = ("contacts.f1.at=[90 deg]", "contacts.f2.at=[-90 deg]")
    out, (fault,) = refused(capsys, "planar_exchange", circle, *at)
    place = r"planar_exchange.yaml:\d+:\d+: phase 'slide': "
    assert re.search(place + r"'force' stays at 0\.\d+, above 0\.001", fault)
    assert "the grasp does not come into balance (choose other contact points" in fault
    warning = r"warning: comes within \d+\.\d mm, less than the safety distance of 50 mm"
    assert re.search(warning, out)

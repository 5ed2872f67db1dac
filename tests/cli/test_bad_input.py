"""What cannot be run is refused before the run: one clear line per fault, code 2, no traceback."""

from __future__ import annotations

import errno
import os

import pytest

from wbc.cli import main

from .shell import ROOT, SHORT, wbc

YAML = (ROOT / "tasks/planar_exchange.yaml").read_text(encoding="utf-8")
URDF = (ROOT / "urdf/planar_bimanual.urdf").read_text(encoding="utf-8")


def refused(capsys, *arguments: str) -> list[str]:
    """The lines with which a command is refused."""
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.removeprefix("compiling the kernels (once)...\n").splitlines()
    assert lines and all(line.strip() for line in lines)
    return lines


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("scenario", "line"),
    [
        ("planar_exchnage", "did you mean 'planar_exchange'?"),
        ("missing.yaml", "missing.yaml: no such file"),
        ("no/such/folder/x.yaml", "no such file"),
        (".", "is a folder"),
        ("", "no scenario"),
        ("a\0b", "no such file"),
    ],
)
def test_scenarios_that_are_not_there(capsys, command, scenario, line):
    told = refused(capsys, command, scenario)
    assert len(told) == 1
    assert line in told[0]


def test_every_fault_of_a_file_has_its_place(capsys, elsewhere):
    text = YAML.replace("gain: 20 /s", "gain: -3 /s").replace("f1: left_tip_a", "f1: left_tip_x")
    (elsewhere / "bad.yaml").write_text(text, encoding="utf-8")
    assert any(line.startswith("bad.yaml:") for line in refused(capsys, "run", "bad.yaml"))
    text = YAML.replace("type: object_pose", "type: object_posse").replace("name: slide", "nme: s")
    (elsewhere / "bad.yaml").write_text(text, encoding="utf-8")
    lines = refused(capsys, "check", "bad.yaml")
    assert len(lines) >= 2
    assert all(line.startswith("bad.yaml:") for line in lines)
    assert any("did you mean 'object_pose'?" in line for line in lines)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", b"{", b"a: [1, 2", b"!!python/object:x y"]
)
def test_files_that_are_no_scenario(capsys, elsewhere, content):
    (elsewhere / "bad.yaml").write_bytes(content)
    assert refused(capsys, "run", "bad.yaml")[0].startswith("bad.yaml:")


def test_a_robot_that_does_not_pass_the_check(capsys, elsewhere):
    (elsewhere / "mine.urdf").write_text(URDF.replace('<mass value="3"/>', '<mass value="-3"/>'))
    (elsewhere / "mine.yaml").write_text(YAML.replace("urdf: planar_bimanual", "urdf: mine.urdf"))
    lines = refused(capsys, "run", "mine.yaml")
    assert all("mine.urdf:" in line and "mass" in line for line in lines)


def test_a_start_that_cannot_be_closed(capsys):
    lines = refused(capsys, "run", "planar_exchange", "--set", "object.pose.position=[9, 9]")
    assert "cannot reach its contact point" in lines[0]


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("simulation.duration=.nan", "must be a finite number"),
        ("simulation.duration=-1 s", "simulation.duration"),
        ("simulation.step=", "simulation.step"),
        ("simulation.stepp=1 ms", "did you mean 'step'?"),
        ("simulation.duration", "write KEY=VALUE"),
        ("=3", "write KEY=VALUE"),
        ("tasks.force.gain=[1", "tasks.force.gain"),
    ],
)
def test_settings_that_make_no_sense(capsys, setting, line):
    assert any(line in told for told in refused(capsys, "run", "planar_exchange", "--set", setting))


def test_a_key_set_twice(capsys):
    twice = ("--set", "simulation.seed=1", "--seed", "2")
    assert "set twice" in refused(capsys, "run", "planar_exchange", *twice)[0]


@pytest.mark.parametrize("out", ["/proc/nowhere", "/dev/null", "a file", "full/log"])
def test_a_folder_that_cannot_be_written(capsys, elsewhere, out):
    (elsewhere / "a file").write_text("mine")
    (elsewhere / "full/log/log.npz").mkdir(parents=True)
    lines = refused(capsys, "run", "planar_exchange", *SHORT, "--out", out)
    assert len(lines) == 1
    assert "cannot write to" in lines[0] and "--out" in lines[0]
    assert (elsewhere / "a file").read_text() == "mine"


def test_a_disk_found_full_before_the_run(capsys, elsewhere, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("wbc.cli.session.tempfile.TemporaryFile", full)
    lines = refused(capsys, "run", "planar_exchange", *SHORT)
    assert "No space left on device" in lines[0]


def test_a_disk_full_after_the_run(capsys, elsewhere, monkeypatch):
    """The report is still made; what could not be written is told once per file, and the code."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("wbc.files.os.fsync", full)
    assert main(("run", "planar_exchange", *SHORT, "--out", "out")) == 1
    told = capsys.readouterr()
    assert "planar_exchange: no success" in told.out
    assert "written to" not in told.out
    assert told.err.count("No space left on device") == 4
    assert list((elsewhere / "out").iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("frob",),
        ("run",),
        ("run", "planar_exchange", "--frob"),
        ("run", "planar_exchange", "--port", "0"),
        ("run", "planar_exchange", "--port", "x"),
        ("run", "planar_exchange", "--realtime", "--fast"),
        ("view", "x", "--rate", "nan"),
        ("view", "x", "--rate", "0"),
    ],
)
def test_arguments_argparse_refuses(capsys, arguments):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage: wbc" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["view", "plot"])
def test_runs_that_are_not_there(capsys, elsewhere, command):
    (elsewhere / "empty").mkdir()
    (elsewhere / "log.npz").write_bytes(b"no log")
    assert "there is no" in refused(capsys, command, "nowhere")[0]
    assert "there is no" in refused(capsys, command, "empty")[0]
    assert "not a log of wbc" in refused(capsys, command, "log.npz")[0]


def test_a_refusal_in_a_process_of_its_own(elsewhere):
    done = wbc("run", "planar_exchange", "--set", "simulation.duration=.inf", cwd=elsewhere)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(elsewhere.iterdir()) == []

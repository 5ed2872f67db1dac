"""The frame of all commands: help, versions, lists, and what happens when something else fails."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from wbc.cli import main

from .shell import COMMAND, environment, wbc


def test_help_is_quick_to_import():
    """No numerics are loaded to print a help text."""
    code = "import sys, wbc.cli; wbc.cli.parser().format_help(); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=True
    )
    assert not {"numpy", "pinocchio", "pydantic", "yaml", "meshcat"} & set(done.stdout.split())


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    told = capsys.readouterr().out
    assert all(
        name in told for name in ("run", "check", "view", "plot", "assemble", "list", "schema")
    )


def test_version_names_pin(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    import pinocchio

    assert f"pin {pinocchio.__version__}" in capsys.readouterr().out


def test_list_has_a_line_for_everything_that_travels(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    exchange = next(line for line in lines if line.split()[0] == "planar_exchange")
    assert "fingers 1, 2 to fingers 3, 4" in exchange
    gripper = next(line for line in lines if line.split()[0] == "planar_gripper")
    assert gripper.endswith("7 joints, moves in the plane")
    assert not any("broken" in line for line in lines)


def test_schema_is_json(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["title"] == "wbc scenario"
    assert "phases" in schema["properties"]


def _fail(*_: object) -> None:
    raise RuntimeError("two\nlines")


def test_a_fault_of_wbc_itself_is_one_line(capsys, monkeypatch):
    monkeypatch.setattr("wbc.cli.catalog.list_command", _fail)
    monkeypatch.delenv("WBC_DEBUG", raising=False)
    assert main(["list"]) == 70
    told = capsys.readouterr().err
    assert told == (
        "wbc: internal error, please report it: RuntimeError: two lines "
        "(WBC_DEBUG=1 shows the traceback)\n"
    )
    monkeypatch.setenv("WBC_DEBUG", "1")
    with pytest.raises(RuntimeError):
        main(["list"])


def test_a_reader_that_has_seen_enough(tmp_path):
    shell = f"{' '.join(COMMAND)} schema | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", shell], env=environment(), capture_output=True, text=True, check=False
    )
    assert done.stdout == "{\n"
    assert done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_written(tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, "list"], env=environment(), stdout=full, stderr=subprocess.PIPE, text=True,
            check=False,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "wbc: [Errno 28] No space left on device\n"


def test_python_m_wbc_works_from_anywhere(tmp_path):
    assert "planar_exchange" in wbc("list", cwd=tmp_path).stdout

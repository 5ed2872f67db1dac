"""What the README says is so: commands, example, tick, links, messages."""

from __future__ import annotations

import inspect
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from wbc import resources
from wbc.cli import main, parser
from wbc.control.controller import Controller

from .readme import ROOT, TEXT, blocks, links, shell_lines, tick_rows

EXCHANGE = resources.find("tasks", "planar_exchange")


def extras() -> set[str]:
    """Names of the extras in pyproject.toml (no TOML reader before Python 3.11)."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    section = text.split("[project.optional-dependencies]")[1].split("\n[")[0]
    return set(re.findall(r"^(\w+) = \[", section, re.MULTILINE))


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    loop, torques, forces, synergies = blocks("python")
    exec(compile(loop, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("0.198 ")
    exec(compile(torques, "README.md", "exec"), {})
    assert capsys.readouterr().out.endswith("<TorqueStatus.BAD_MEASUREMENT: 4>\n")
    scope: dict[str, object] = {}
    exec(compile(forces, "README.md", "exec"), scope)
    assert capsys.readouterr().out.startswith("solved ")
    c = scope["solution"].c.reshape(3, 3)  # type: ignore[attr-defined]
    assert c[:, 1] == pytest.approx(np.full(3, 2.0 / 3.0))  # a third of the weight each
    exec(compile(synergies, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("[0.599 0.772 0.85 ] ")


@pytest.mark.parametrize("line", [line for line in shell_lines() if line.startswith("wbc ")])
def test_wbc_commands_are_understood(line: str) -> None:
    words = shlex.split(line)[1:]
    if len(words) > 1 or words[0] in ("list", "schema"):
        assert parser().parse_args(words).command
        return
    with pytest.raises(SystemExit) as ended:  # only named: there is such a command
        parser().parse_args([*words, "--help"])
    assert ended.value.code == 0


@pytest.mark.parametrize("line", [line for line in shell_lines() if line.startswith("pip ")])
def test_pip_commands_name_extras_that_exist(line: str) -> None:
    asked = re.findall(r"\.\[(\w+)\]", line)
    assert set(asked) <= extras()
    assert asked or "pip install ." in line or "==" in line


def test_the_commands_cover_set_up_run_and_test() -> None:
    lines = shell_lines()
    assert lines[:2] == [
        "python3 -m venv .venv && . .venv/bin/activate",
        "pip install -e '.[dev]'",
    ]
    assert "wbc run planar_exchange --view" in lines


def test_the_test_command_is_the_one_that_ci_runs() -> None:
    (command,) = (line for line in shell_lines() if line.startswith("pytest"))
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert re.search(rf"^tests .* {re.escape(command)}$", run, re.MULTILINE)
    assert os.access(ROOT / ".ci" / "run", os.X_OK)


def test_the_table_of_the_tick_names_functions_that_exist() -> None:
    rows = tick_rows()
    assert len(rows) == 12
    for call, path in rows:
        assert re.search(rf"^ *def {call}\(", path.read_text(encoding="utf-8"), re.MULTILINE), call


def test_the_table_of_the_tick_is_in_the_order_of_the_code() -> None:
    source = inspect.getsource(Controller.step)
    outer = [call for k, (call, _) in enumerate(tick_rows(), 1) if k == 1 or k >= 7]
    places = [re.search(rf"\b{call}\(", source) for call in outer]
    assert all(places), outer
    starts = [place.start() for place in places if place]
    assert starts == sorted(starts)


@pytest.mark.parametrize("link", links())
def test_links_lead_somewhere(link: str) -> None:
    assert (ROOT / link).exists()


def test_every_room_is_on_the_map() -> None:
    rooms = {path.parent.name for path in (ROOT / "wbc").glob("*/__init__.py")}
    assert rooms == set(re.findall(r"`wbc/(\w+)`\]", TEXT))


def faults(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code and first line of a command."""
    code = main(arguments)
    out, err = capsys.readouterr()
    return code, (err if code == 2 else out).splitlines()[0]


def alike(line: str) -> str:
    """A line without what may change with the numbers of the scenario."""
    return re.sub(r"[\d.]+(e[+-]?\d+)?", "#", line)


def test_messages_are_what_the_tool_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    unknown, short, late = (block.strip() for block in blocks(""))
    monkeypatch.chdir(tmp_path)
    text = EXCHANGE.read_text(encoding="utf-8")
    mine = tmp_path / "my_exchange.yaml"
    mine.write_text(text.replace("type: manipulability", "type: manipulabilty"), encoding="utf-8")
    code, line = faults(capsys, "check", mine.name)
    assert (code, alike(line)) == (2, alike(unknown))
    mine.write_text(text, encoding="utf-8")
    code, line = faults(capsys, "check", mine.name, "--set", "object.pose.position=[0, 3]")
    assert (code, alike(line)) == (2, alike(short))
    code, line = faults(
        capsys, "run", mine.name, "--set", "object.pose.position=[-1.2, 0]", "--out", "away"
    )
    # what is lacking, and how much, may change with the scenario
    assert (code, alike(line).split(" s: ")[0]) == (1, alike(late).split(" s: ")[0])


def test_another_object_is_a_change_of_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = blocks("yaml")
    surface = block.splitlines()[1]
    text = EXCHANGE.read_text(encoding="utf-8")
    changed, count = re.subn(r"^  surface: .*$", surface, text, count=1, flags=re.MULTILINE)
    assert count == 1 and changed != text
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_exchange.yaml").write_text(changed, encoding="utf-8")
    assert main(["run", "my_exchange.yaml", "--out", "run"]) == 0, capsys.readouterr()

"""docs/own_robot.md, followed to the letter: every file written, every command run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from wbc.cli import main

from .own_robots import need_example_robots

PAGE = Path(__file__).resolve().parents[2] / "docs" / "own_robot.md"
TEXT = PAGE.read_text(encoding="utf-8")


def blocks() -> list[tuple[str, str]]:
    """Language and content of the fenced blocks, in order."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)


def alike(line: str) -> str:
    """A line without what rounding may change, and without its columns."""
    return " ".join(re.sub(r"[\d.]+(e[+-]?\d+)?", "#", line).split())


def test_the_page_can_be_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    need_example_robots()
    monkeypatch.chdir(tmp_path)
    code, said, ran = 0, "", 0
    for language, content in blocks():
        if language == "yaml":
            name = content.splitlines()[0].removeprefix("# ")
            Path(name).write_text(content, encoding="utf-8")
        for line in content.splitlines() if language == "sh" else ():
            if line.startswith("wbc "):
                code = main(shlex.split(line)[1:])
                captured = capsys.readouterr()
                said, ran = captured.out + captured.err, ran + 1
                assert code == (2 if "--set" in line else 0), said
        if not language:  # what the command before it says, some lines left out
            lines = [alike(line) for line in said.splitlines()]
            for line in content.splitlines():
                assert any(found.startswith(alike(line)) for found in lines), (line, said)
    assert ran == 7


def test_what_the_page_names_exists() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (PAGE.parent / link).exists(), link
    assert PAGE.parent.parent.joinpath("tests/scenario/test_own_robot_page.py").exists()
    installs = [x for language, text in blocks() if language == "sh" for x in text.splitlines()]
    assert "pip install -e '.[fast]'" in installs

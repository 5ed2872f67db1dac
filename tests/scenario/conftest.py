"""The faults that loading a text reports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wbc.errors import ScenarioError
from wbc.scenario import load

from .hold import COMPLETE


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str | bytes], Path]:
    """Writes t.yaml in a folder that is the working one, so that faults begin with 't.yaml:'."""
    monkeypatch.chdir(tmp_path)

    def writer(text: str | bytes) -> Path:
        path = tmp_path / "t.yaml"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return writer


@pytest.fixture
def faults(write: Callable[[str | bytes], Path]) -> Callable[..., list[str]]:
    """The lines of the error that a text gives; none if it loads."""

    def lines(text: str | bytes, **overrides: object) -> list[str]:
        named = {name.replace("__", "."): value for name, value in overrides.items()}
        try:
            load(write(text), named)
        except ScenarioError as error:
            return str(error).splitlines()
        return []

    return lines


@pytest.fixture
def broken(faults: Callable[..., list[str]]) -> Callable[[str, str], list[str]]:
    """The faults of `COMPLETE` with one text replaced, without the file name."""

    def lines(old: str, new: str) -> list[str]:
        assert COMPLETE.count(old) == 1, f"{old!r} occurs {COMPLETE.count(old)} times"
        return [line.removeprefix("t.yaml:") for line in faults(COMPLETE.replace(old, new))]

    return lines

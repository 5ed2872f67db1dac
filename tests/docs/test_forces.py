"""What docs/forces.md says of keys and statuses is so."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tests.forces.problems import two_hands
from wbc.forces import ForceStatus, solve

from .readme import ROOT

TEXT = (ROOT / "docs" / "forces.md").read_text(encoding="utf-8")


def keys(section: str) -> set[str]:
    """Names in the first column of a section's tables."""
    part = TEXT.split(f"## {section}\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", part, re.MULTILINE)
    return {name for row in rows for name in re.findall(r"`(\w+)`", row)}


def test_keys_of_the_files(tmp_path: Path) -> None:
    problem = two_hands()
    problem.save(tmp_path / "p.npz")
    solve(problem).save(tmp_path / "r.npz")
    assert keys("The problem") == set(np.load(tmp_path / "p.npz").files)
    statuses = {status.value for status in ForceStatus}
    assert keys("The answer") == set(np.load(tmp_path / "r.npz").files) | statuses


def test_statuses_say_whether_forces_may_be_applied() -> None:
    for status in ForceStatus:
        (word,) = re.findall(rf"^\| `{status.value}` \| (\w+) \|", TEXT, re.MULTILINE)
        assert (word == "yes") == status.usable

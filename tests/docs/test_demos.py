"""Every demo runs headless, and the numbered ones are all here."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from .readme import ROOT

DEMOS = sorted((ROOT / "demos").glob("*.py"))


def test_demos_are_numbered() -> None:
    assert [path.name[:3] for path in DEMOS] == [f"{k:02d}_" for k in range(1, len(DEMOS) + 1)]


@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demo_runs_for_fifty_ticks(demo: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(demo), "--ticks", "50"],
        cwd=tmp_path,  # from any folder
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
    assert "nan" not in done.stdout
    assert not list(tmp_path.iterdir()), "a demo leaves no files"

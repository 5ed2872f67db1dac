"""What travels in the wheel: installed somewhere else, without the checkout, it works."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from .shell import PATIENCE, ROOT


@pytest.mark.slow
def test_an_installed_wheel_brings_its_robots_scenarios_and_page(tmp_path):
    pytest.importorskip("pip")
    place, cwd = tmp_path / "installed", tmp_path / "elsewhere"
    cwd.mkdir()
    built = subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(place),
         "--disable-pip-version-check", str(ROOT)],
        cwd=cwd, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    if "Could not find a version" in built.stderr or "No matching distribution" in built.stderr:
        pytest.skip("the build backend cannot be had here")
    assert built.returncode == 0, built.stderr
    assert (place / "wbc/_data/urdf/planar_bimanual.urdf").is_file()
    assert (place / "wbc/_data/tasks/planar_exchange.yaml").is_file()
    assert {p.name for p in (place / "wbc/view/page").iterdir()} >= {"page.html", "live.js"}
    # the wheel's own copy, not the checkout that may be installed for development
    # uncompiled: a copy elsewhere would have to compile its kernels anew for a few ticks
    environment = {**os.environ, "PYTHONPATH": str(place), "NUMBA_DISABLE_JIT": "1"}

    def installed(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "wbc", *arguments], cwd=cwd, env=environment,
            capture_output=True, text=True, timeout=PATIENCE, check=False,
        )  # fmt: skip

    assert str(place) in subprocess.run(
        [sys.executable, "-c", "import wbc; print(wbc.__file__)"], cwd=cwd, env=environment,
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    listed = installed("list")
    assert listed.returncode == 0, listed.stderr
    assert "planar_exchange" in listed.stdout and "planar_gripper" in listed.stdout
    done = installed("run", "planar_exchange", "--set", "simulation.duration=0.05", "--out", "out")
    assert done.returncode == 1, done.stderr
    shown = installed("view", "out", "--html", "run.html")
    assert shown.returncode == 0, shown.stderr
    assert (cwd / "run.html").stat().st_size > 500_000

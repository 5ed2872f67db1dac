"""A run in a real browser, while it is going on: headless Chromium by Playwright's client."""

from __future__ import annotations

import io
import os
import re

import matplotlib.image
import numpy as np
import pytest

from .shell import CARRY, PHASES, arrays, finish, start, wait_for_tick, wbc

CHROMIUM = "/usr/bin/chromium"
ARGS = [
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # without it the picture may be blank, with exit code 0
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
OBJECT = "viewer.scene_tree.find(['wbc', 'object']).object"
BODY = "viewer.scene_tree.find(['wbc', 'robot', 'right_b_1']).object"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def page():
    """One page for all runs; it is open before they begin, as loading it takes seconds here."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs the playwright client")
    if not os.access(CHROMIUM, os.X_OK):
        pytest.skip(f"needs Debian's chromium at {CHROMIUM}")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        opened = browser.new_page(viewport={"width": 1000, "height": 640})
        opened.faults = []
        opened.on("pageerror", lambda error: opened.faults.append(str(error)))
        yield opened
        browser.close()


class Live:
    """A run under way and the page that follows it."""

    def __init__(self, page, folder, *arguments: str, scenario: str = "planar_exchange") -> None:
        self.page = page
        self.process = start(
            "run", scenario, "--view", "--no-browser", "--out", "out", *arguments,
            cwd=folder,
        )  # fmt: skip
        line = self.process.stdout.readline()
        self.url = re.search(r"http://127\.0\.0\.1:\d+/", line).group()
        wait_for_tick(self.process)
        page.goto(self.url)
        page.wait_for_function("viewer.num_messages_received > 60")

    def poses(self, node: str, count: int) -> np.ndarray:
        """Position and quaternion of a node at several instants of the run, (count, 7)."""
        seen = []
        for _ in range(count):
            assert self.process.poll() is None, "the run was over before it was looked at"
            seen.append(
                self.page.evaluate(
                    f"[...{node}.position.toArray(), ...{node}.quaternion.toArray()]"
                )
            )
            self.page.wait_for_timeout(150)
        return np.array(seen)

    def pixels(self) -> np.ndarray:
        """The page as (height, width, 3) in 0..1."""
        shot = io.BytesIO(self.page.screenshot())
        return matplotlib.image.imread(shot, format="png")[:, :, :3]


def near(pixels: np.ndarray, color: tuple[float, float, float], tolerance: float = 0.12) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels - np.array(color)).max(axis=2) < tolerance).sum())


def test_the_object_is_seen_to_move_while_the_run_is_live(page, tmp_path):
    live = Live(page, tmp_path, "--set", CARRY, "--set", "simulation.duration=6")
    seen = live.poses(OBJECT, 6)
    assert live.process.poll() is None
    moved = np.linalg.norm(np.diff(seen[:, :2], axis=0), axis=1)
    assert (moved > 0.0).sum() >= 3, f"the object stands still: {seen}"
    _, errors = finish(live.process)
    assert live.process.returncode == 0, errors
    # what was seen lies on the path that was recorded
    path = arrays(tmp_path / "out/log.npz")["object_pose"]
    for pose in seen:
        assert np.abs(path - pose).max(axis=1).min() < 2e-3
    assert page.faults == []


def test_the_exchange_is_seen_while_the_run_is_live(page, tmp_path):
    live = Live(page, tmp_path)
    seen = live.poses(BODY, 5)
    assert np.ptp(seen[:, :2], axis=0).max() > 1e-4, f"the robot stands still: {seen}"
    pixels = live.pixels()
    assert near(pixels, (0.94, 0.67, 0.24)) > 2000, "the object is not in the picture"
    assert near(pixels, (0.27, 0.43, 0.62)) > 400, "the left trunk is not in the picture"
    assert near(pixels, (0.16, 0.68, 0.35)) > 100, "no contact is green"
    assert page.locator("#wbc-panel .phase").count() == len(PHASES)
    assert page.locator("#wbc-panel .phase.now").count() == 1
    names = page.locator("#wbc-panel .task .name").all_inner_texts()
    assert names == ["object", "force", "moment", "dexterity", "palm"]
    assert page.locator("#wbc-panel .task:not(.out)").count() >= 3
    finish(live.process)
    assert live.process.returncode == 0
    assert page.faults == []


FORCES = """() => ['f1', 'f2'].flatMap((finger) => ['force', 'measured'].map((kind) => {
  const { scale, visible } = viewer.scene_tree.find(['wbc', 'forces', finger, kind]).object;
  return visible ? scale.z : 0.0;
}))"""


def lengths(page) -> np.ndarray:
    """Of the arrows of fingers 1 and 2, planned and measured of each, [m]; 0 where hidden."""
    return np.array(page.evaluate(FORCES))


def test_planned_and_measured_forces_are_seen_live_and_in_the_replay(page, tmp_path):
    """20 N are planned, and what is measured is near that, never the same, and varies."""
    live = Live(
        page, tmp_path, "--set", "simulation.duration=1.5", scenario="planar_exchange_dynamic"
    )
    legend = page.locator("#wbc-panel .legend .name").all_inner_texts()
    assert legend == ["planned", "measured", "torque limit", "friction cone", "weight", "resultant"]
    page.wait_for_function(f"({FORCES})().every((length) => length > 0.0)")
    seen = []
    while len(seen) < 5:
        seen.append(lengths(page))
        page.wait_for_timeout(100)
    assert live.process.poll() is None, "the run was over before it was looked at"
    finish(live.process)
    log = arrays(tmp_path / "out/log.npz")
    planned, measured = (
        np.linalg.norm(log[name], axis=2)[:, :2]
        for name in ("contact_force_plan", "contact_force_meas")
    )
    scale = 0.3 / planned[log["t"] == 0.0].max()
    both = scale * np.stack((planned, measured), axis=2).reshape(-1, 4)
    for lengths_seen in seen:
        assert np.abs(both - lengths_seen).max(axis=1).min() < 1e-4, "no tick has these forces"
    assert np.ptp(seen, axis=0)[[1, 3]].max() > 0.0, "measured forces stand still"

    wbc("view", "out", "--html", "run.html", cwd=tmp_path)
    page.goto((tmp_path / "run.html").as_uri())
    page.wait_for_function("viewer.animator.playing && viewer.animator.time > 0.05")
    page.click("#wbc-player button")
    for t in (0.2, 1.0):
        page.locator("#wbc-player input").fill(str(t))
        label = f"document.querySelector('#wbc-panel .value').textContent === '{t:.2f} s'"
        page.wait_for_function(label)
        page.wait_for_timeout(200)
        k = int(np.argmin(np.abs(log["t"] - t)))
        np.testing.assert_allclose(lengths(page), both[k], rtol=0.02)
    pixels = live.pixels()
    assert near(pixels, (0.05, 0.60, 0.20)) > 20, "no planned force is green"
    assert near(pixels, (0.60, 0.15, 0.75)) > 20, "no measured force is violet"
    assert page.faults == []

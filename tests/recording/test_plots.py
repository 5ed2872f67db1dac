"""The pictures: they show what the log holds, whatever it holds, and leave matplotlib as it was."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wbc.errors import WbcError
from wbc.recording.figures import COLORS, WARNING
from wbc.recording.plots import joint_groups, motion, object_error, plot

from .runs import recorded, removed_and_back, without_limits

NAMES = ["object_error", "residuals", "tasks", "stack", "motion", "safety"]


def share(
    path: Path, color: str, region: tuple[slice, slice] = (slice(None), slice(None))
) -> float:
    """Part of a picture's pixels that have `color`, nearly."""
    pixels = matplotlib.image.imread(path)[region][..., :3]
    return float((np.abs(pixels - to_rgb(color)).max(axis=-1) < 0.02).mean())


def inked(path: Path) -> float:
    """Part of a picture's pixels that are not white."""
    return float((matplotlib.image.imread(path)[..., :3].min(axis=-1) < 0.9).mean())


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plots") / "new"
    log = recorded(160, removed_and_back())
    assert plot(log, folder) == [folder / f"{name}.png" for name in NAMES]
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_no_picture_is_blank(pictures: Path, name: str) -> None:
    height, width, _ = matplotlib.image.imread(pictures / f"{name}.png").shape
    assert width == 1440 and height > 300
    assert 0.01 < inked(pictures / f"{name}.png") < 0.6


def test_every_finger_has_its_curve_on_both_sides(pictures: Path) -> None:
    path = pictures / "object_error.png"
    above_legend, left, right = slice(0, 400), slice(0, 720), slice(720, 1440)
    assert share(path, COLORS[0], (above_legend, left)) > 1e-3
    assert share(path, COLORS[0], (above_legend, right)) > 1e-3
    assert share(path, COLORS[1], (above_legend, left)) > 1e-3


def test_residuals_are_drawn_apart_with_their_threshold(pictures: Path) -> None:
    path = pictures / "residuals.png"
    everywhere, left, right = slice(None), slice(0, 720), slice(720, 1440)
    assert share(path, COLORS[0], (everywhere, left)) > 1e-3
    assert share(path, COLORS[0], (everywhere, right)) == 0.0
    assert share(path, COLORS[1], (everywhere, right)) > 1e-3
    assert share(path, WARNING, (everywhere, left)) > 1e-4


def test_the_stack_shows_the_gains(tmp_path: Path) -> None:
    """The main task's bar is full; a task of gain 0.25 fills a quarter of its own."""
    whole = {k: {"within": np.ones(4, bool)} for k in range(100)}
    (path,) = (p for p in plot(recorded(100, whole), tmp_path) if p.stem == "stack")
    pixels = matplotlib.image.imread(path)[..., :3]

    def opaque(color: str) -> int:
        # bars are drawn at 85 %, on a frame at 18 %, on the shades of the phases
        near = np.abs(pixels - (0.85 * np.array(to_rgb(color)) + 0.14)).max(axis=-1) < 0.06
        return int(near.sum())

    full, quarter = opaque(COLORS[0]), opaque(COLORS[2])
    assert full > 10_000
    assert quarter / full == pytest.approx(0.25, abs=0.08)


def test_supervisor_events_are_marked(pictures: Path, tmp_path: Path) -> None:
    plot(recorded(160), tmp_path)
    assert share(pictures / "stack.png", WARNING) > share(tmp_path / "stack.png", WARNING) + 5e-5
    red = [
        (pixels[..., 0] - pixels[..., 1:3].max(axis=-1) > 0.3).sum()
        for pixels in (
            matplotlib.image.imread(folder / "motion.png") for folder in (pictures, tmp_path)
        )
    ]
    assert red[0] > red[1] + 200


def test_the_same_log_gives_the_same_pictures(pictures: Path, tmp_path: Path) -> None:
    with matplotlib.rc_context({"lines.linewidth": 9.0, "text.usetex": True, "font.size": 30}):
        before = dict(matplotlib.rcParams)
        plot(recorded(160, removed_and_back()), tmp_path)
        assert dict(matplotlib.rcParams) == before
    for name in NAMES:
        assert (tmp_path / f"{name}.png").read_bytes() == (pictures / f"{name}.png").read_bytes()


def test_no_window_system_is_asked_for(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom tests.recording.runs import recorded\n"
        "from wbc.recording.plots import plot\nplot(recorded(5), sys.argv[1])\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    env = {**os.environ, "MPLBACKEND": "tkagg", "DISPLAY": ""}
    subprocess.run([sys.executable, "-c", code, tmp_path], check=True, env=env)


def test_a_run_does_not_load_matplotlib() -> None:
    code = "import sys, wbc.recording; assert 'matplotlib' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


nan, inf = np.nan, np.inf
ODD = {
    "one tick": (1, {}),
    "two ticks": (2, {}),
    "nothing but NaN": (
        20,
        {
            k: {
                "object_error": np.full((2, 2), nan),
                "residuals": (nan, nan),
                "task_error": np.full(4, nan),
                "cost": nan,
                "min_distance": nan,
                "q": np.full(3, nan),
                "v": np.full(3, nan),
                "activation": np.full(4, nan),
            }
            for k in range(20)
        },
    ),
    "infinities": (
        20,
        {
            k: {"residuals": (inf, -inf), "cost": inf, "min_distance": inf, "v": np.full(3, inf)}
            for k in range(10)
        },
    ),
    "zeros": (
        20,
        {
            k: {
                "object_error": np.zeros((2, 2)),
                "residuals": (0.0, 0.0),
                "task_error": np.zeros(4),
                "cost": 0.0,
                "q": np.zeros(3),
                "v": np.zeros(3),
            }
            for k in range(20)
        },
    ),
    "penetration": (20, {k: {"min_distance": -0.1} for k in range(20)}),
    "huge": (20, {k: {"residuals": (1e300, 1e-300), "cost": 1e300} for k in range(20)}),
    "phases that flicker": (60, {k: {"phase": k % 2} for k in range(60)}),
}


@pytest.mark.parametrize("case", ODD)
@pytest.mark.filterwarnings("error")
def test_runs_that_went_wrong_are_drawn_too(tmp_path: Path, case: str) -> None:
    ticks, changes = ODD[case]
    files = plot(recorded(ticks, changes, without_limits()), tmp_path)
    assert all(inked(path) > 0.005 for path in files)


def test_nothing_recorded_nothing_drawn(tmp_path: Path) -> None:
    with pytest.raises(WbcError, match="nothing to plot"):
        plot(recorded(0), tmp_path)


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WbcError, match=r"\Acannot write '.*object_error\.png': .*\Z"):
        plot(recorded(3), tmp_path / "file")


def test_joints_by_limb() -> None:
    assert joint_groups(["shoulder", "elbow", "wrist"]) == [
        ("shoulder", [0]), ("elbow", [1]), ("wrist", [2])
    ]  # fmt: skip
    hands = [f"{side}_{f}_{k}" for side in ("left", "right") for f in "abcde" for k in range(3)]
    assert [(name, len(js)) for name, js in joint_groups(["torso_1", *hands])] == [
        ("torso", 1), ("left", 15), ("right", 15)
    ]  # fmt: skip
    arms = [f"{side}_{limb}_{k}" for side in "lr" for limb in ("arm", "hand") for k in range(7)]
    assert [name for name, _ in joint_groups(arms)] == ["l_arm", "l_hand", "r_arm", "r_hand"]
    assert joint_groups([f"joint{k}" for k in range(30)]) == [("joints", list(range(30)))]


@pytest.mark.parametrize("limits", [True, False])
def test_many_joints_have_few_labels(limits: bool) -> None:
    """Forty joints and ten fingers: an entry per limb, the names of the furthest, nothing more."""
    few = recorded(60)
    names = tuple(f"{side}_arm_{k}" for side in ("left", "right") for k in range(20))
    bounds = (2.0,) * 40 if limits else ()
    meta = replace(
        few.meta, joint_names=names, q_upper=bounds, q_lower=tuple(-b for b in bounds),
        v_limit=bounds, contact_names=tuple(f"f{k}" for k in range(10)),
    )  # fmt: skip
    q = np.sin(few.t)[:, None] * np.linspace(-0.5, 1.9, 40)
    log = replace(
        few, meta=meta, joint_names=names, q=q, v=np.gradient(q, few.t, axis=0),
        contact_names=meta.contact_names, object_error=np.full((60, 10, 2), 1e-9),
    )  # fmt: skip
    figure = motion(log)
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == ["left_arm (20)", "right_arm (20)"]
    top, middle, _ = figure.axes
    written = [t.get_text() for t in top.texts if t.get_text() in names]
    assert written[:1] == (["right_arm_19"] if limits else [])
    assert "right_arm_19" in [t.get_text() for t in middle.texts]
    if limits:
        shares = np.array([line.get_ydata() for line in top.lines if len(line.get_ydata()) == 60])
        np.testing.assert_allclose(np.sort(shares[:, -1]), np.sort((q[-1] + 2.0) / 4.0))
    (fingers,) = object_error(log).legends
    assert fingers._ncols == 5, "two even rows"

"""Figures 4 to 10: every case in its colour, what failed left out, what is forbidden in yellow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wbc.forces.study import CASES, CaseRun
from wbc.recording.figures import FORBIDDEN
from wbc.recording.force_figures import (
    BLUE,
    CYAN,
    GRAY,
    GREEN,
    NEWTON,
    ORANGE,
    RED,
    UNLIMITED,
    VIOLET,
    ForceStudy,
    fan,
    force_cones,
    force_effort,
    force_limits,
    force_norms,
    load_sharing,
    plot_study,
    split_limits,
    split_norms,
)

from .runs import recorded

LOG = recorded(100)
T = 40
NAMES = ("r_thumb", "r_index", "l_thumb", "l_index")
ONE_HAND = ["force_cones", "force_limits", "force_norms", "force_effort"]


def case_run(k: int, **changes: np.ndarray) -> CaseRun:
    """Case k of four contacts with a joint each: what it holds is told by k."""
    t = np.linspace(0.0, 1.0, T)
    c = np.tile([0.0, 0.0, 1.0 + k], (T, 4))
    c[:, 1] = 0.3 * (1.0 + k) * np.sin(2.0 * np.pi * t)
    made = CaseRun(
        c=c,
        tau=np.full((T, 4), 0.1 * (1 + k)),
        cone_margin=np.ones((T, 4)),
        torque_margin=np.column_stack([np.full(T, 0.1 * (k - 3.5)), np.full((T, 3), np.inf)]),
        phi=np.ones(T),
        seconds=1e-5 * (1.0 + k) * (1.0 + t),
        steps=np.ones(T, dtype=int),
        active=np.full(T, 8 - k),
        solved=np.ones(T, dtype=bool),
        share=np.column_stack([0.3 + 0.1 * t, 0.7 - 0.1 * t]),
        load_force=np.column_stack([np.full(T, 2.0 + k), np.full(T, 1.0)]),
        load_moment=np.column_stack([np.full(T, 0.2), np.full(T, 0.1 + k)]),
    )
    return made._replace(**changes)


def study(hands: tuple[int, ...] = (0, 0, 1, 1), **changes: CaseRun) -> ForceStudy:
    names = [case.name for case in (*CASES, NEWTON, UNLIMITED)]
    runs = {name: case_run(k) for k, name in enumerate(names) if any(hands) or "split" not in name}
    return ForceStudy(
        t=np.linspace(0.1, 0.9, T),
        names=NAMES,
        hands=np.array(hands),
        mu=np.full(4, 0.6),
        frames=np.tile(np.eye(3), (T, 4, 1, 1)),
        first=3 * np.arange(4),
        own=np.array([True, True, True, False]),
        runs={**runs, **{name.replace("_", " "): run for name, run in changes.items()}},
    )


def curves(axes) -> dict[str, tuple[str, np.ndarray]]:
    """Label to colour and values."""
    return {
        line.get_label(): (line.get_color(), np.asarray(line.get_ydata()))
        for line in axes.lines
        if len(line.get_xdata()) == T
    }


def test_two_hands_have_seven_pictures_one_hand_four(tmp_path: Path) -> None:
    files = plot_study(LOG, study(), tmp_path / "two")
    assert [f.stem for f in files] == [*ONE_HAND, "split_norms", "split_limits", "load_sharing"]
    again = plot_study(LOG, study(), tmp_path / "again")
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(files, again, strict=True))
    assert [f.stem for f in plot_study(LOG, study((0,) * 4), tmp_path / "one")] == ONE_HAND


def test_a_fan_is_what_the_arrow_sweeps() -> None:
    # a quarter turn at 2 N, there and back at 1 N, to 45° on both sides
    angle = np.linspace(-np.pi / 4, np.pi / 4, 50)
    x = np.concatenate((2.0 * np.sin(angle), np.sin(angle[::-1])))
    z = np.concatenate((2.0 * np.cos(angle), np.cos(angle[::-1])))
    rim = fan(x, z)
    area = 0.5 * abs(
        np.sum(rim[:, 0] * np.roll(rim[:, 1], -1) - rim[:, 1] * np.roll(rim[:, 0], -1))
    )
    assert area == pytest.approx(np.pi, rel=0.03), "a quarter of a disk of 2 N"
    assert np.hypot(*rim.T).max() == pytest.approx(2.0, rel=1e-3)
    assert np.hypot(*fan(np.array([0.0]), np.array([1.0])).T).max() == pytest.approx(1.0)
    narrow = fan(0.01 * np.sin(angle), np.ones(50))
    assert np.abs(narrow[:, 0]).max() == pytest.approx(0.01 * np.sin(np.pi / 4), rel=0.03)


def test_figure_4_forces_stand_in_their_cones() -> None:
    made = study()
    figure = force_cones(made)
    assert [axes.get_title() for axes in figure.axes] == [n.replace("_", " ") for n in NAMES]
    rows = [axes.get_subplotspec().rowspan.start for axes in figure.axes]
    assert rows == [0, 0, 1, 1], "a row for a hand"
    blue, red, cone = figure.axes[0].lines
    assert [line.get_color() for line in (blue, red, cone)] == [BLUE, RED, GREEN]
    for line, name in ((blue, "newton none"), (red, "newton")):
        run = made.runs[name]
        np.testing.assert_allclose(np.abs(line.get_xdata()), np.abs(run.c[:, 1]), atol=1e-9)
        np.testing.assert_allclose(line.get_ydata(), run.c[:, 2])
    np.testing.assert_allclose(np.abs(cone.get_xdata()), 0.6 * np.asarray(cone.get_ydata()))


def test_forces_turn_with_the_frames_into_the_objects_axes() -> None:
    turned = np.tile(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), (T, 4, 1, 1))
    made = replace(study(), frames=turned)
    c = made.runs["all"].c.reshape(T, 4, 3)
    np.testing.assert_allclose(made.forces("all"), np.roll(c, 1, axis=2))
    gone = np.arange(T) != 7
    lost = study(all=case_run(0, solved=gone))
    assert np.isnan(lost.forces("all")[7]).all() and np.isfinite(lost.forces("all")[8]).all()


def test_figures_5_and_9_show_what_breaks_a_limit_on_yellow() -> None:
    for figure, want in (
        (force_limits(LOG, study()), {"without torque limits": (BLUE, 8),
                                      "with torque limits": (RED, 7)}),
        (split_limits(LOG, study()), {"each hand on its own": (BLUE, 5),
                                      "the same, weighted": (GREEN, 6), "both together": (RED, 0)}),
    ):  # fmt: skip
        (axes,) = figure.axes
        found = curves(axes)
        assert set(found) == set(want)
        for label, (color, k) in want.items():
            assert found[label][0] == color
            np.testing.assert_allclose(found[label][1], 0.1 * (k - 3.5))
        (band,) = [p for p in axes.patches if p.get_facecolor()[:3] == to_rgb(FORBIDDEN)]
        assert band.get_extents().y1 == pytest.approx(axes.transData.transform((0.0, 0.0))[1])


def test_figures_6_and_8_show_norms_of_wrenches_and_of_the_fingers_torques() -> None:
    for figure, label, k in (
        (force_norms(LOG, study()), "without torque limits", 8),
        (split_norms(LOG, study()), "the same, weighted", 6),
    ):
        wrenches, torques = figure.axes
        c = case_run(k).c
        np.testing.assert_allclose(curves(wrenches)[label][1], np.linalg.norm(c, axis=1))
        np.testing.assert_allclose(curves(torques)[label][1], 0.1 * (1 + k) * np.sqrt(3.0))


def test_figure_7_is_in_percent_of_the_slowest_tick_with_all_bounds() -> None:
    time, bounds = force_effort(LOG, study()).axes
    found = curves(time)
    assert found["all"][1].max() == pytest.approx(100.0)
    want = (
        ("none (+400 %)", GRAY), ("each hand on its own (+500 %)", CYAN),
        ("the same, weighted (+600 %)", VIOLET), ("all, by Newton's method (+700 %)", ORANGE),
    )  # fmt: skip
    assert [found[label][0] for label, _ in want] == [color for _, color in want]
    assert found["none (+400 %)"][1].max() == pytest.approx(500.0)
    counted = curves(bounds)
    names = {"all", "none", *(f"$\\sigma_\\tau$ = {s}" for s in ("0", "0.5", "0.8"))}
    assert set(counted) == names, "the bounds of what splits are all of them"
    np.testing.assert_array_equal(counted["none"][1], 4.0)


def test_only_the_phases_of_the_ticks_shown_are_named() -> None:
    (axes,) = force_limits(LOG, replace(study(), t=np.linspace(0.6, 0.9, T))).axes
    assert [text.get_text() for text in axes.texts] == ["slide"]  # since 0.5 s
    assert axes.get_xlim() == (0.6, 0.9)
    (axes,) = force_limits(LOG, study()).axes
    assert [text.get_text() for text in axes.texts] == ["reach", "slide"]


def test_figure_10_sets_the_hands_side_by_side() -> None:
    share, force, moment = load_sharing(LOG, study()).axes
    np.testing.assert_allclose(curves(share)["r, each hand"][1], case_run(6).share[:, 0])
    found = curves(force)
    assert [found[f"{h}, together"][0] for h in "rl"] == [RED, BLUE]
    np.testing.assert_allclose(found["r, each hand"][1], 8.0)
    np.testing.assert_allclose(found["r, together"][1], 2.0)
    np.testing.assert_allclose(curves(moment)["l, each hand"][1], 6.1)
    dashed = {line.get_label() for line in force.lines if line.is_dashed()}
    assert dashed == {"r, together", "l, together"}


def test_ticks_that_found_nothing_leave_a_gap() -> None:
    made = study(split=case_run(5, solved=np.arange(T) > 4))
    (axes,) = split_limits(LOG, made).axes
    values = curves(axes)["each hand on its own"][1]
    assert np.isnan(values[:5]).all() and np.isfinite(values[5:]).all()


def test_hands_without_a_common_name_are_numbered() -> None:
    made = replace(study(), names=("thumb", "index", "l_thumb", "l_index"))
    assert made.hand_names() == ["hand 1", "l"]

"""The plots of a run, after Figures 15, 17, 18 and 19 of the chapter, and those of its limits."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from wbc.arrays import Array, BoolArray
from wbc.errors import WbcError
from wbc.recording.dynamic_facts import object_error_true
from wbc.recording.dynamic_plots import force_errors, torques
from wbc.recording.figures import (
    COLORS,
    DASHES,
    GREY,
    WARNING,
    above_zero,
    log_axis,
    panels,
    save,
    style,
    threshold,
    time_axis,
)
from wbc.recording.force_plots import forces
from wbc.recording.log import Log
from wbc.recording.summary import CONVERGED, velocity_steps

_MOST_JOINTS = 12  # with a colour of their own
_LEGEND = 8  # entries side by side
TRUE = "#141419"
"""Of what is true, beside what is known."""
_STRIP = 0.1  # part of a panel's height in which the gain is drawn, below the curve


def plot(log: Log, out_dir: str | os.PathLike[str]) -> list[Path]:
    """Draw every plot of a run as PNG into a folder, which is made if it is missing.

    Returns:
        The files: where fingers touch an object ``object_error`` and ``residuals``; ``tasks``,
        ``stack``, ``motion``, ``safety``; where contact forces were planned ``forces``, and where
        torques moved the robot ``force_errors`` and ``torques``.

    Raises:
        WbcError: nothing was recorded, or a file cannot be written.
    """
    if not log.ticks:
        raise WbcError("nothing to plot: the log holds no tick")
    figures = {
        "object_error": object_error,
        "residuals": residuals,
        "tasks": tasks,
        "stack": stack,
        "motion": motion,
        "safety": safety,
    }
    if not log.contact_names:
        del figures["object_error"], figures["residuals"]  # there is no object
    if log.plans_forces:
        figures["forces"] = forces
    if log.dynamic:
        figures |= {"force_errors": force_errors, "torques": torques}
    files = []
    with style(), np.errstate(all="ignore"):  # a run that went wrong is still drawn
        for name, draw in figures.items():
            files.append(save(draw(log), Path(out_dir) / f"{name}.png"))
    return files


def object_error(log: Log) -> Figure:
    """Figure 15: the object's pose error as each finger in contact sees it, and the true one."""
    figure, (left, right) = panels(1, 2)
    true = object_error_true(log) if log.dynamic else None
    for axes, part, title, label in (
        (left, 0, "Object position error", "‖position error‖ [m]"),
        (right, 1, "Object orientation error", "‖orientation error‖ [rad]"),
    ):
        time_axis(axes, log, title, label)
        errors = above_zero(log.object_error[:, :, part])
        for i, name in enumerate(log.contact_names):
            axes.plot(
                log.t, errors[:, i], color=COLORS[i % len(COLORS)], label=name,
                linestyle=DASHES[(i // len(COLORS)) % len(DASHES)],
            )  # fmt: skip
        shown = [errors]
        if true is not None:
            shown.append(above_zero(true[part]))
            axes.plot(log.t, shown[1], color=TRUE, linewidth=1.6, label="the object itself")
        log_axis(axes, shown)
    _legend_below(figure, left, len(log.contact_names) + (true is not None))
    return figure


def residuals(log: Log) -> Figure:
    """Figure 17: the residuals of the unit frictionless equilibrium (44)-(45)."""
    figure, (left, right) = panels(1, 2)
    for axes, values, title, label, color in (
        (left, log.eps_f, "Force residual", "$\\epsilon_f$ [1]", COLORS[0]),
        (right, log.eps_m, "Moment residual", "$\\epsilon_m$ [m²]", COLORS[1]),
    ):
        time_axis(axes, log, title, label)
        axes.plot(log.t, above_zero(values), color=color)
        log_axis(axes, [values, np.array([CONVERGED])])
        threshold(axes, CONVERGED, "force closure")
    return figure


def tasks(log: Log) -> Figure:
    """Figure 18: the functions of the secondary tasks, with their gains below them."""
    first = int(log.meta.main_task is not None)
    shown = list(range(first, len(log.task_names))) or list(range(len(log.task_names)))
    figure, axes_list = panels(max((len(shown) + 1) // 2, 1), 2, height=2.6)
    for axes, k in zip(axes_list, shown, strict=False):
        unit = log.meta.task_units[k] if log.meta.task_units else ""
        time_axis(axes, log, log.task_names[k], f"‖error‖ [{unit}]" if unit else "‖error‖")
        error = log.task_error[:, k]
        axes.plot(log.t, error, color=COLORS[0], label="norm of the task's error")
        top = float(np.max(error, initial=0.0, where=np.isfinite(error)))
        axes.set_ylim(-0.2 * (top or 1.0), 1.12 * (top or 1.0))
        gain = np.clip(np.nan_to_num(log.activation[:, k]), 0.0, 1.0)
        axes.fill_between(
            log.t, _STRIP * gain, color=COLORS[4], alpha=0.7, linewidth=0,
            transform=axes.get_xaxis_transform(), label="gain ρ, 0 to 1, in the strip below",
        )  # fmt: skip
        axes.axhline(0.0, color="#AAAAAA", linewidth=0.6, zorder=0.5)
    if shown:
        _legend_below(figure, axes_list[0], 2)
    for axes in axes_list[len(shown) :]:
        axes.set_axis_off()
    return figure


def stack(log: Log) -> Figure:
    """Figure 19: which tasks are in the stack, the main one as number 1 at the bottom."""
    count, tips = len(log.task_names), len(log.tip_task_names)
    figure, (axes,) = panels(1, 1, height=1.2 + 0.42 * (count + tips))
    time_axis(axes, log, "Stack status", "")
    for k in range(count):
        _bar(axes, log, k, log.in_stack[:, k], log.activation[:, k], COLORS[k % len(COLORS)])
    for k in range(tips):
        _bar(axes, log, count + k, log.tip_in_stack[:, k], log.tip_activation[:, k], GREY)
    for t, task, inserted in zip(log.event_t, log.event_task, log.event_inserted, strict=True):
        axes.plot(
            [t], [task + 1], marker="^" if inserted else "v", color=WARNING, markersize=7,
            markeredgecolor="white", linestyle="none", clip_on=False, zorder=5,
        )  # fmt: skip
    labels = [f"{name}   {k + 1}" for k, name in enumerate(log.task_names)]
    axes.set_yticks(range(1, count + tips + 1), labels + list(log.tip_task_names))
    for label in axes.get_yticklabels()[count:]:
        label.set_color(GREY)
    axes.set_ylim(0.4, count + tips + 0.6)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(
        "time [s]     bar: in the stack, filled to its gain     "
        "▼ removed, ▲ put back by the supervisor"
    )
    return figure


def _bar(axes: Axes, log: Log, row: int, within: BoolArray, activation: Array, color: str) -> None:
    """One task along time: a frame while it is in the stack, filled as high as its gain."""
    low, size = row + 0.68, 0.64
    axes.fill_between(
        log.t, low, low + size, where=within.tolist(), step="post", color=color, alpha=0.18,
        linewidth=0,
    )  # fmt: skip
    gain = np.clip(np.nan_to_num(activation), 0.0, 1.0)
    axes.fill_between(log.t, low, low + size * gain, color=color, alpha=0.85, linewidth=0)


def motion(log: Log) -> Figure:
    """Joint positions, velocities, and the largest step of a velocity in one tick.

    Of many joints the positions are shown within their limits, and instead of a colour for each
    joint there is one per limb, with the names of the joints that come furthest.
    """
    figure, (top, middle, bottom) = panels(3, 1, height=2.3)
    many = len(log.joint_names) > _MOST_JOINTS
    time_axis(middle, log, "Joint velocities", "v [rad/s] ([m/s])")
    time_axis(bottom, log, "Largest velocity step per tick", "max |Δv| [rad/s]")
    if many:
        _many_joints(top, middle, log)
    else:
        _few_joints(top, middle, log)
    _limit_lines(middle, () if many else _both(log.meta.v_limit))
    steps = velocity_steps(log)
    bottom.plot(log.t, above_zero(steps), color=COLORS[0])
    log_axis(bottom, [steps], most_decades=8)
    for t in log.event_t:
        bottom.axvline(t, color=WARNING, linewidth=0.8, linestyle=(0, (2, 2)))
    entries = top.get_legend_handles_labels()
    if many:
        figure.legend(*entries, loc="outside lower center", fontsize=7.5, ncols=len(COLORS))
    else:
        figure.legend(*entries, loc="outside right upper", fontsize=7.5)
    return figure


def _few_joints(top: Axes, middle: Axes, log: Log) -> None:
    """A colour and an entry of the legend for each."""
    time_axis(top, log, "Joint positions", "q [rad] ([m])")
    n = len(log.joint_names)
    for j, name in enumerate(log.joint_names):
        color, dash = colormaps["viridis"](0.95 * j / max(n - 1, 1)), DASHES[j % len(DASHES)]
        top.plot(log.t, log.q[:, j], color=color, linestyle=dash, label=name)
        middle.plot(log.t, log.v[:, j], color=color, linestyle=dash)
    degrees = top.secondary_yaxis("right", functions=(np.rad2deg, np.deg2rad))
    degrees.set_ylabel("[°]")
    _limit_lines(top, (*log.meta.q_lower, *log.meta.q_upper))


def _many_joints(top: Axes, middle: Axes, log: Log) -> None:
    """A colour for each limb, and the names of those joints that come furthest."""
    limbs = joint_groups(log.joint_names)
    of = {j: k for k, (_, members) in enumerate(limbs) for j in members}
    lower, upper = (np.array(limit) for limit in (log.meta.q_lower, log.meta.q_upper))
    within = len(lower) > 0 and bool(np.isfinite([lower, upper]).all())
    time_axis(
        top, log, "Joint positions" + (" within their limits" if within else ""),
        "share of the range [1]" if within else "q [rad] ([m])",
    )  # fmt: skip
    shown = (log.q - lower) / (upper - lower) if within else log.q
    for k, (limb, members) in enumerate(limbs):
        color = COLORS[k % len(COLORS)]
        top.plot(log.t, shown[:, members], color=color, linewidth=0.8, alpha=0.75)
        middle.plot(log.t, log.v[:, members], color=color, linewidth=0.8, alpha=0.75)
        top.plot([], [], color=color, label=f"{limb} ({len(members)})")
    if within:
        _name_furthest(top, log, shown, np.abs(shown - 0.5), of)
        top.set_ylim(-0.08, 1.08)
        threshold(top, 1.0, "upper limits")
        threshold(top, 0.0, "lower limits")
    _name_furthest(middle, log, log.v, np.abs(log.v), of)


def _name_furthest(
    axes: Axes, log: Log, shown: Array, score: Array, limb: dict[int, int], count: int = 3
) -> None:
    """Write the names of the joints of the largest scores (T, n) at their curves."""
    score = np.where(np.isfinite(score), score, -1.0)
    placed: list[tuple[float, float]] = []
    low, high = axes.get_ylim()
    wide, tall = 0.25 * float(np.ptp(log.t)), 0.1 * (high - low)
    for j in np.argsort(-score.max(axis=0), kind="stable"):
        k = int(np.argmax(score[:, j]))
        x, y = float(log.t[k]), float(shown[k, j])
        if len(placed) == count or score[k, j] <= 0.0:
            return
        if any(abs(x - a) < wide and abs(y - b) < tall for a, b in placed):
            continue  # it would be written over another
        placed.append((x, y))
        axes.annotate(
            log.joint_names[j], (x, y), xytext=(3, -7 if y > 0.5 * (low + high) else 3),
            textcoords="offset points", fontsize=7.0, zorder=6,
            color=COLORS[limb[int(j)] % len(COLORS)],
            ha="left" if x < 0.5 * (log.t[0] + log.t[-1]) else "right",
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
        )  # fmt: skip


def joint_groups(names: Sequence[str]) -> list[tuple[str, list[int]]]:
    """Joints by limb: as many parts of their names, cut at underscores, as give few groups.

    Returns:
        Name of the limb and the joints' indices, in the order of the joints.
    """
    parts = [re.split(r"[_./ -]+", name) for name in names]
    for depth in (2, 1):
        groups: dict[str, list[int]] = {}
        for j, words in enumerate(parts):
            groups.setdefault("_".join(words[: min(depth, max(len(words) - 1, 1))]), []).append(j)
        if len(groups) <= len(COLORS):
            return list(groups.items())
    return [("joints", list(range(len(names))))]


def _limit_lines(axes: Axes, limits: tuple[float, ...]) -> None:
    """Limits near the motion as lines; one far from it would flatten it."""
    low, high = axes.get_ylim()
    room = 0.15 * (high - low)
    shown = [x for x in sorted(set(limits)) if low - room < x < high + room]
    axes.set_ylim(min([low, *(x - 0.1 * room for x in shown)]), max([high, *shown]) + room)
    for value in shown:
        threshold(axes, value, "limit")


def _both(limits: tuple[float, ...]) -> tuple[float, ...]:
    return limits + tuple(-x for x in limits)


def safety(log: Log) -> Figure:
    """Smallest distance, cost with the supervisor's thresholds, and what the limit filter left."""
    figure, (top, middle, bottom) = panels(3, 1, height=2.1)
    meta = log.meta
    time_axis(top, log, "Smallest distance of the watched pairs", "d [m]")
    distance = np.where(np.isfinite(log.min_distance), log.min_distance, np.nan)
    top.plot(log.t, distance, color=COLORS[0])
    highest = float(np.max(distance, initial=0.0, where=np.isfinite(distance)))
    lowest = float(np.min(distance, initial=0.0, where=np.isfinite(distance)))
    top.set_ylim(1.1 * lowest, 1.15 * highest or 1.0)
    threshold(top, meta.safety_distance, "safety distance")
    time_axis(middle, log, "Cost", "$C_\\Sigma$")
    middle.plot(log.t, log.cost, color=COLORS[1])
    peak = float(np.max(log.cost, initial=0.0, where=np.isfinite(log.cost)))
    height = max(peak, meta.remove_above or 0.0) or 1.0
    middle.set_ylim(-0.03 * height, 1.2 * height)
    threshold(middle, meta.remove_above, "task removed above")
    threshold(middle, meta.insert_below, "task put back below")
    time_axis(bottom, log, "Shares left by the limit filter", "share [1]")
    for k, (name, share) in enumerate(
        (
            ("secondary tasks", log.limit_secondary),
            ("main task", log.limit_main),
            ("change of velocity", log.limit_change),
        )
    ):
        bottom.plot(log.t, share, color=COLORS[k], linestyle=DASHES[k], label=name)
    clipped = log.t[log.limit_clipped]
    if len(clipped):
        bottom.plot(
            clipped, np.zeros(len(clipped)), "x", color=WARNING, markersize=4,
            label="joints clipped one by one", clip_on=False,
        )  # fmt: skip
    bottom.set_ylim(0.0, 1.08)
    bottom.legend(loc="lower right", ncols=4)
    return figure


def _legend_below(figure: Figure, axes: Axes, count: int) -> None:
    rows = -(-count // _LEGEND)
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center",
        ncols=max(-(-count // max(rows, 1)), 1),
    )  # fmt: skip

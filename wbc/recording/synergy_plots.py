"""Synergies as circular graphs and as points in the space of their weights (Figures 21 and 26)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, takewhile
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from wbc.arrays import Array
from wbc.recording.figures import COLORS, GREY, WARNING
from wbc.synergies import Synergies, Tables

FINGER_COLORS = (COLORS[4], COLORS[0], COLORS[2], COLORS[3], COLORS[6], COLORS[1], COLORS[5])
"""Of the fingers, from the first one of a posture on."""

_COLUMNS = 3
_HOLE = 0.45  # radius without bars at the middle, in radii of the outermost ring
_MARKS = {"star": ("o", COLORS[0]), "diamond": ("^", COLORS[2]), "": (".", "#B8BEC8")}
_NAMED = (
    "C5", "C10", "C11", "C12", "C13", "C16", "C19", "C20", "C23", "C27", "C29", "C30", "C34",
    "C36",
)  # fmt: skip
_BESIDE = np.array((3.0, 0.0, 2.0))  # a point, its name; [deg]


def finger_names(joints: Sequence[str], fingers: Sequence[int]) -> tuple[str, ...]:
    """What the names of each finger's joints begin with, else ``finger 1`` and so on."""
    names = []
    for k in range(max(fingers, default=-1) + 1):
        own = [j for j, f in zip(joints, fingers, strict=True) if f == k]
        letters = zip(*own, strict=False)
        shared = "".join(c[0] for c in takewhile(lambda c: len(set(c)) == 1, letters))
        shared = shared if len(own) > 1 else own[0].rpartition("_")[0]
        names.append(shared.rstrip("_-. 0123456789").replace("_", " "))
    distinct = all(names) and len(set(names)) == len(names)
    return tuple(names) if distinct else tuple(f"finger {k + 1}" for k in range(len(names)))


def circular(synergies: Synergies, fingers: Sequence[int]) -> Figure:
    """Figure 21: how far each joint turns for a weight of one degree, [deg].

    A bar goes outwards from the dark circle where the joint turns positively, inwards, and hatched,
    where negatively.

    Args:
        fingers: (n,) number of each joint's finger, from 0.
    """
    count, n = synergies.count, len(synergies.joints)
    columns = min(count, _COLUMNS)
    rows = -(-count // columns)
    figure = Figure(
        figsize=(max(3.5 * columns, 4.0), 3.9 * rows + 0.5), dpi=150, layout="constrained"
    )
    FigureCanvasAgg(figure)
    angle = 2.0 * np.pi * np.arange(n) / n
    inner, outer = min(float(synergies.basis.min()), 0.0), max(float(synergies.basis.max()), 0.0)
    reach = 1.05 * (outer - inner)
    color = [FINGER_COLORS[f % len(FINGER_COLORS)] for f in fingers]
    for k in range(count):
        axes: Any = figure.add_subplot(rows, columns, k + 1, projection="polar")
        axes.set_theta_zero_location("N")
        axes.set_theta_direction(-1)
        _bars(axes, angle, synergies.basis[:, k], color)
        axes.set_ylim(outer - reach, inner + reach)
        axes.set_rorigin(outer - reach - _HOLE * reach)
        for j in range(n):
            if fingers[j] != fingers[j - 1]:  # a line between two fingers
                axes.axvline(angle[j] - np.pi / n, color="#AAB4C0", linewidth=0.8, zorder=1)
        axes.set_title(f"e$_{{{k + 1}}}$", pad=12.0, loc="center")
        axes.set_xticks(angle, [str(j + 1) for j in range(n)], fontsize=8.0)
        axes.tick_params(axis="x", pad=-2.0)
        axes.grid(axis="x", visible=False)
        axes.spines["polar"].set_visible(False)
        axes.tick_params(axis="y", labelsize=6.0, labelcolor=GREY)
        axes.set_rlabel_position(-180.0 / n)  # between the last joint and the first
    names = finger_names(synergies.joints, fingers)
    patches = [
        Patch(color=FINGER_COLORS[k % len(FINGER_COLORS)], label=_numbered(name, k, fingers))
        for k, name in enumerate(names)
    ]
    figure.suptitle(
        "Angular change of each joint [deg] for +1 deg of the weight; inwards and hatched: negative"
        if columns > 1 else "Angular change [deg] for +1 deg of the weight", fontsize=9.5,
    )  # fmt: skip
    most = 5 if columns > 2 else 3
    figure.legend(handles=patches, loc="outside lower center", ncols=min(len(patches), most))
    return figure


def _bars(axes: Any, angle: Array, change: Array, color: Sequence[str]) -> None:
    width = 0.72 * 2.0 * np.pi / len(angle)
    bars = axes.bar(angle, change, width=width, color=color, zorder=3)
    for bar, value, own in zip(bars, change, color, strict=True):
        if value < 0.0:
            bar.set(facecolor="white", edgecolor=own, hatch="//////", linewidth=0.8)
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(around, np.zeros(len(around)), color="#333333", linewidth=1.0, zorder=4)


def _numbered(name: str, finger: int, fingers: Sequence[int]) -> str:
    """A finger's name with the numbers of its joints; runs as ``4-6``."""
    own = [j + 1 for j, f in enumerate(fingers) if f == finger]
    breaks = [0, *(k + 1 for k, (a, b) in enumerate(pairwise(own)) if b != a + 1), len(own)]
    runs = [own[a:b] for a, b in pairwise(breaks)]
    return f"{name} ({', '.join(f'{r[0]}-{r[-1]}' if len(r) > 1 else str(r[0]) for r in runs)})"


def weights(tables: Tables, path: Array) -> Figure:
    """Figure 26: the weights of the published grasps in the space of the three synergies.

    Args:
        path: (k, 3) weights between which a hand moves linearly, [deg]; drawn as a dashed line.
    """
    figure = Figure(figsize=(9.0, 6.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.view_init(elev=24.0, azim=-52.0)
    words = {"star": "grasped with two synergies", "diamond": "grasped thanks to the third",
             "": "others of the reference set"}  # fmt: skip
    floor = 1.08 * float(min(tables.weights[:, 2].min(), path[:, 2].min()))
    for mark, (shape, color) in _MARKS.items():
        own = tables.weights[[m == mark for m in tables.marks]]
        size = 34.0 if mark else 22.0
        axes.scatter(*own.T, marker=shape, color=color, s=size, label=words[mark],
                     depthshade=False, zorder=4)  # fmt: skip
    axes.scatter(*tables.new_weights.T, marker="o", facecolors="none", edgecolors=COLORS[1],
                 s=46.0, linewidths=1.4, label="new objects, G1 to G5", depthshade=False,
                 zorder=5)  # fmt: skip
    everything = np.concatenate((tables.weights, tables.new_weights))
    for x, y, z in everything:  # feet on the floor say where a point is
        axes.plot((x, x), (y, y), (floor, z), color="#D9DEE6", linewidth=0.6, zorder=1)
    axes.scatter(*path[:1].T, marker="s", color=WARNING, s=16.0, depthshade=False, zorder=6)
    axes.text(*(path[0] + _BESIDE), "zero offset", fontsize=7.0, color=WARNING, zorder=7)
    axes.plot(*path.T, color=WARNING, linestyle=(0, (5, 3)), linewidth=1.5, zorder=6,
              label="a reach to grasp: zero offset, open hand, C27")  # fmt: skip
    for name, at in zip((*tables.names, *tables.new_names), everything, strict=True):
        if name in _NAMED or name in tables.new_names:
            axes.text(*(at + _BESIDE), name, fontsize=7.0, zorder=7)
    axes.set_zlim(floor, 1.05 * float(everything[:, 2].max()))
    for k, letter in enumerate("xyz"):
        getattr(axes, f"set_{letter}label")(f"$\\alpha_{k + 1}$ [deg]")
    axes.set_box_aspect((1.25, 1.15, 0.85), zoom=1.08)
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, markerscale=0.9
    )
    return figure

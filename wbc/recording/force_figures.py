"""Figures 4 to 10 of the chapter, of the ticks of a run solved again in several ways."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.arrays import Array, IntArray
from wbc.recording.figures import DASHES, forbid_negative, panels, time_axis
from wbc.recording.log import Log

BLUE, RED, GREEN, CYAN, VIOLET, BLACK, GRAY = (
    "#1F5FBF", "#C8202F", "#1E8E3E", "#18A7B5", "#7B3FA0", "#202020", "#8A8A8A",
)  # fmt: skip
"""As the chapter's captions name them."""
_SECTORS = 180  # of the half plane on the inner side of a contact


class Curve(NamedTuple):
    """One line of a figure: `values` (T,)."""

    label: str
    color: str
    values: Array
    dash: int = 0


def force_cones(
    names: Sequence[str], hands: IntArray, mu: Array, normals: Array, free: Array, limited: Array
) -> Figure:
    """Figure 4: what each contact force covers of its friction cone, a row of axes for a hand.

    Seen along the surface, so that most of the tangential force lies in the picture: upwards the
    normal component, sideways the tangential one. No force can be beyond the green lines.

    Args:
        hands: (n,) the hand of each contact, from 0 on.
        mu: (n,) its friction coefficient.
        normals: (T, n, 3) inward normals in the object's axes.
        free, limited: (T, n, 3) forces without and with torque limits, in the object's axes.
    """
    rows = [np.flatnonzero(hands == h).tolist() for h in range(int(hands.max()) + 1)]
    columns = max(map(len, rows))
    figure, axes_list = panels(len(rows), columns, height=2.3)
    for axes in axes_list:
        axes.set_axis_off()
    for row, members in enumerate(rows):
        for column, i in enumerate(members):
            axes = axes_list[row * columns + column]
            axes.set_axis_on()
            _cone(axes, names[i], float(mu[i]), normals[:, i], free[:, i], limited[:, i])
    entries = axes_list[0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=3)
    return figure


def _parts(normals: Array, forces: Array) -> tuple[Array, Array]:
    """(T,) normal and (T, 3) tangential parts of forces (T, 3)."""
    press = np.sum(normals * forces, axis=1)
    return press, forces - press[:, None] * normals


def _cone(axes: Axes, name: str, mu: float, normals: Array, free: Array, limited: Array) -> None:
    """The force of one contact in both cases, (T, 3)."""
    parts = [_parts(normals, forces) for forces in (free, limited)]
    axis = _main_direction(np.concatenate([tangential for _, tangential in parts]))
    top = 0.0
    for (z, tangential), color, label in zip(
        parts, (BLUE, RED), ("without torque limits", "with torque limits"), strict=True
    ):
        x = tangential @ axis
        known = np.isfinite(x) & np.isfinite(z)
        if not known.any():
            continue
        axes.fill(*fan(x[known], z[known]).T, color=color, alpha=0.25, linewidth=0)
        axes.plot(x, z, color=color, linewidth=0.9, label=label)
        top = max(top, float(z[known].max()))
    top = 1.1 * top or 1.0
    axes.plot(
        [-mu * top, 0.0, mu * top], [top, 0.0, top], color=GREEN, linewidth=1.1,
        label="friction cone",
    )  # fmt: skip
    axes.set_xlim(-1.05 * mu * top, 1.05 * mu * top)
    axes.set_ylim(0.0, top)
    axes.set_title(name.replace("_", " "), fontsize=8.5, pad=4.0)
    axes.set_xlabel("tangential [N]", fontsize=7.0)
    axes.set_ylabel("normal [N]", fontsize=7.0)
    axes.tick_params(labelsize=7.0)


def _main_direction(tangential: Array) -> Array:
    """(3,) along which most of the forces (k, 3) point."""
    known = tangential[np.isfinite(tangential).all(axis=1)]
    return np.asarray(np.linalg.eigh(known.T @ known)[1][:, -1])


def fan(x: Array, z: Array) -> Array:
    """(k, 2) outline of all that an arrow from the origin sweeps, its tip going along x, z (T,)."""
    step = np.linspace(0.0, 1.0, 24)[:, None]
    x, z = ((v[:-1] + step * np.diff(v)).ravel() if len(v) > 1 else v for v in (x, z))
    angle = np.arctan2(x, np.maximum(z, 0.0))
    sector = np.minimum(((angle / np.pi + 0.5) * _SECTORS).astype(np.int64), _SECTORS - 1)
    reach = np.zeros(_SECTORS)
    np.maximum.at(reach, sector, np.hypot(x, z))
    swept = np.flatnonzero(reach)
    edges = (np.stack((swept, swept + 1), axis=1).ravel() / _SECTORS - 0.5) * np.pi
    length = np.repeat(reach[swept], 2)
    rim = np.column_stack((length * np.sin(edges), length * np.cos(edges)))
    return np.vstack((np.zeros(2), rim))


def compared(
    log: Log, t: Array, parts: Sequence[tuple[str, str, Sequence[Curve]]], *, margin: bool = False
) -> Figure:
    """Time histories side by side, of the same cases.

    Args:
        t: (T,) of the values.
        parts: title, label of the ordinate, curves.
        margin: what is below zero is forbidden.
    """
    figure, axes_list = panels(1, len(parts))
    for axes, (title, label, curves) in zip(axes_list, parts, strict=True):
        time_axis(axes, log, title, label)
        for curve in curves:
            axes.plot(
                t, curve.values, color=curve.color, label=curve.label, linewidth=1.1,
                linestyle=DASHES[curve.dash],
            )  # fmt: skip
        if margin:
            forbid_negative(axes)
        else:
            axes.set_ylim(bottom=0.0)
    entries = axes_list[0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=min(len(entries[0]), 4))
    return figure

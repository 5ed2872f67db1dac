"""Figures 4 to 10 of the chapter, of the ticks of a run solved again in several ways."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.arrays import Array, BoolArray, IntArray
from wbc.forces.study import Case, CaseRun, percent
from wbc.recording.figures import DASHES, forbid_negative, log_axis, panels, save, style, time_axis
from wbc.recording.log import Log

BLUE, RED, GREEN, CYAN, VIOLET, BLACK, GRAY = (
    "#1F5FBF", "#C8202F", "#1E8E3E", "#18A7B5", "#7B3FA0", "#202020", "#8A8A8A",
)  # fmt: skip
"""As the chapter's captions name them."""
ORANGE = "#E07B00"
NEWTON = Case("newton", method="newton")
UNLIMITED = Case("newton none", limits=False, method="newton")
"""By the run's own solver, whose optimum Figures 4 to 6 show; the chapter's flow is in the rest."""
_BOTH = (
    (UNLIMITED.name, "without torque limits", BLUE), (NEWTON.name, "with torque limits", RED),
)  # fmt: skip
_SPLIT = (
    ("split", "each hand on its own", BLUE), ("split weighted", "the same, weighted", GREEN),
    ("all", "both together", RED),
)  # fmt: skip
_EFFORT = (
    ("all", "all", BLACK), ("sigma 0", "$\\sigma_\\tau$ = 0", RED),
    ("sigma 0.5", "$\\sigma_\\tau$ = 0.5", GREEN), ("sigma 0.8", "$\\sigma_\\tau$ = 0.8", BLUE),
    ("none", "none", GRAY), ("split", "each hand on its own", CYAN),
    ("split weighted", "the same, weighted", VIOLET),
    (NEWTON.name, "all, by Newton's method", ORANGE),
)  # fmt: skip
_HANDS = (RED, BLUE, GREEN)
_SECTORS = 120  # of what an arrow sweeps


@final
@dataclass(frozen=True)
class ForceStudy:
    """Ticks of a run, and what each case of section 1.5 makes of them.

    Attributes:
        t: (T,) of the ticks, [s].
        names: of the n contacts.
        hands: (n,) the hand of each, from 0 on; all 0: one hand, and no case splits.
        mu: (n,) friction coefficients.
        frames: (T, n, 3, 3) contact frames in the object's axes, columns x, y, z inward.
        first: (n,) where each contact's components begin in c.
        own: (l,) joints that move one contact only: those of the fingers.
        runs: by the names of `wbc.forces.study.CASES`, and of `NEWTON` and `UNLIMITED`.
    """

    t: Array
    names: tuple[str, ...]
    hands: IntArray
    mu: Array
    frames: Array
    first: IntArray
    own: BoolArray
    runs: dict[str, CaseRun]

    @property
    def splits(self) -> bool:
        """Whether there are cases with each hand on its own."""
        return bool(self.hands.any())

    def forces(self, case: str) -> Array:
        """(T, n, 3) forces of a case in the object's axes; NaN where it found none."""
        run = self.runs[case]
        parts = run.c[:, self.first[:, None] + np.arange(3)]
        found: Array = np.einsum("tnij,tnj->tni", self.frames, parts)
        return known(run, found)

    def hand_names(self) -> list[str]:
        """What the names of a hand's contacts begin with, or its number."""
        groups = [
            [name for name, of in zip(self.names, self.hands, strict=True) if of == h]
            for h in range(int(self.hands.max()) + 1)
        ]
        starts = [
            "".join(k[0] for k in takewhile(lambda k: len(set(k)) == 1, zip(*g, strict=False)))
            for g in groups
        ]
        return [start.strip("_ ") or f"hand {h + 1}" for h, start in enumerate(starts)]


def known(run: CaseRun, values: Array) -> Array:
    """`values` (T, ...) where the tick was solved, else NaN."""
    solved = run.solved.reshape(-1, *(1,) * (values.ndim - 1))
    return np.where(solved, values, np.nan)


class Curve(NamedTuple):
    """One line of a figure: `values` (T,)."""

    label: str
    color: str
    values: Array
    dash: int = 0


Part = tuple[str, str, list[Curve]]
"""Title, label of the ordinate and curves of one panel."""


def plot_study(log: Log, study: ForceStudy, out_dir: str | os.PathLike[str]) -> list[Path]:
    """Draw Figures 4 to 10 as PNG into a folder, which is made if it is missing.

    Returns:
        The files: ``force_cones``, ``force_limits``, ``force_norms``, ``force_effort``, and for two
        hands ``split_norms``, ``split_limits``, ``load_sharing``.

    Raises:
        WbcError: a file cannot be written.
    """
    figures: dict[str, Callable[[Log, ForceStudy], Figure]] = {
        "force_cones": lambda _, s: force_cones(s),
        "force_limits": force_limits,
        "force_norms": force_norms,
        "force_effort": force_effort,
    }
    if study.splits:
        figures |= {
            "split_norms": split_norms, "split_limits": split_limits, "load_sharing": load_sharing,
        }  # fmt: skip
    with style(), np.errstate(all="ignore"):
        return [
            save(draw(log, study), Path(out_dir) / f"{name}.png") for name, draw in figures.items()
        ]


def force_cones(study: ForceStudy) -> Figure:
    """Figure 4: what each contact force covers of its friction cone, a row of axes for a hand.

    Seen along the surface, so that most of the tangential force lies in the picture: upwards the
    normal component, sideways the tangential one. No force can be beyond the green lines.
    """
    free, limited = study.forces(UNLIMITED.name), study.forces(NEWTON.name)
    normals, hands = study.frames[..., 2], study.hands
    rows = [np.flatnonzero(hands == h).tolist() for h in range(int(hands.max()) + 1)]
    columns = max(map(len, rows))
    figure, axes_list = panels(len(rows), columns, height=2.3)
    for axes in axes_list:
        axes.set_axis_off()
    for row, members in enumerate(rows):
        for column, i in enumerate(members):
            axes = axes_list[row * columns + column]
            axes.set_axis_on()
            _cone(
                axes, study.names[i], float(study.mu[i]), normals[:, i], free[:, i], limited[:, i]
            )
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
    edges = np.linspace(angle.min(), angle.max() + 1e-9, _SECTORS + 1)
    reach = np.zeros(_SECTORS)
    np.maximum.at(reach, np.searchsorted(edges, angle, side="right") - 1, np.hypot(x, z))
    swept = np.flatnonzero(reach)
    edges = np.stack((edges[swept], edges[swept + 1]), axis=1).ravel()
    length = np.repeat(reach[swept], 2)
    rim = np.column_stack((length * np.sin(edges), length * np.cos(edges)))
    return np.vstack((np.zeros(2), rim))


def force_limits(log: Log, study: ForceStudy) -> Figure:
    """Figure 5: the least distance of a joint torque to its limit, without and with limits."""
    return _compared(log, study, [_distance(study, _BOTH)], margin=True)


def force_norms(log: Log, study: ForceStudy) -> Figure:
    """Figure 6: norms of the contact wrenches and of the joint torques of the fingers."""
    return _compared(log, study, _norms(study, _BOTH))


def split_norms(log: Log, study: ForceStudy) -> Figure:
    """Figure 8: as Figure 6, for each hand on its own and both together."""
    return _compared(log, study, _norms(study, _SPLIT))


def split_limits(log: Log, study: ForceStudy) -> Figure:
    """Figure 9: as Figure 5, for each hand on its own and both together."""
    return _compared(log, study, [_distance(study, _SPLIT)], margin=True)


def force_effort(log: Log, study: ForceStudy) -> Figure:
    """Figure 7: time of the chapter's flow (18), the longest tick with all bounds being 100, and
    the number of torque bounds in the cost. The legend has the change of the mean time."""
    cases = [case for case in _EFFORT if case[0] in study.runs]
    whole = study.runs["all"].seconds.mean()
    time = []
    for name, label, color in cases:
        run = study.runs[name]
        change = 100.0 * (run.seconds.mean() / whole - 1.0)
        told = label if name == "all" else f"{label} ({change:+.0f} %)"
        dash = int(name == NEWTON.name)
        time.append(Curve(told, color, known(run, percent(study.runs, name)), dash))
    count = [
        Curve(label, color, known(study.runs[name], study.runs[name].active.astype(np.float64)))
        for name, label, color in cases
        if not name.startswith("split") and name != NEWTON.name
    ]
    figure = _compared(
        log, study,
        [("Computation effort", "time [%]", time), ("Torque bounds in the cost", "bounds", count)],
    )  # fmt: skip
    log_axis(figure.axes[0], [curve.values for curve in time])
    return figure


def load_sharing(log: Log, study: ForceStudy) -> Figure:
    """Figure 10: what each hand carries, on its own with (22)-(23) (continuous) and together
    (dashed), and above it the coefficients by which the load is shared."""
    local, common = study.runs["split weighted"], study.runs["all"]
    names = study.hand_names()
    parts: list[Part] = [
        (
            "Load-sharing coefficients", "$\\delta_h / \\Sigma\\,\\delta$",
            [
                Curve(f"{name}, each hand", _HANDS[h % 3], known(local, local.share)[:, h])
                for h, name in enumerate(names)
            ],
        )
    ]  # fmt: skip
    for title, label, field in (
        ("Load forces", "‖force‖ [N]", "load_force"),
        ("Load moments", "‖moment‖ [Nm]", "load_moment"),
    ):
        curves = [
            Curve(f"{name}, {how}", _HANDS[h % 3], known(run, getattr(run, field))[:, h], dash)
            for how, run, dash in (("each hand", local, 0), ("together", common, 1))
            for h, name in enumerate(names)
        ]
        parts.append((title, label, curves))
    return _compared(log, study, parts)


def _distance(study: ForceStudy, cases: Sequence[tuple[str, str, str]]) -> Part:
    curves = []
    for name, label, color in cases:
        run = study.runs[name]
        least = np.min(run.torque_margin, axis=1, initial=np.inf)
        least = np.where(np.isfinite(least), least, np.nan)
        curves.append(Curve(label, color, known(run, least)))
    return "Smallest distance to a torque limit", "[Nm]", curves


def _norms(study: ForceStudy, cases: Sequence[tuple[str, str, str]]) -> list[Part]:
    wrenches, torques = [], []
    for name, label, color in cases:
        run = study.runs[name]
        wrenches.append(Curve(label, color, known(run, np.linalg.norm(run.c, axis=1))))
        own = np.linalg.norm(run.tau[:, study.own], axis=1)
        torques.append(Curve(label, color, known(run, own)))
    return [
        ("Contact wrenches", "‖c‖ [N]", wrenches),
        ("Torques of the fingers' joints", "‖$\\tau$‖ [Nm]", torques),
    ]


def _compared(
    log: Log, study: ForceStudy, parts: Sequence[Part], *, margin: bool = False
) -> Figure:
    """Time histories side by side, of the same cases.

    Args:
        margin: what is below zero is forbidden.
    """
    figure, axes_list = panels(1, len(parts))
    entries: dict[str, Any] = {}
    for axes, (title, label, curves) in zip(axes_list, parts, strict=True):
        time_axis(axes, log, title, label, (study.t[0], study.t[-1]))
        for curve in curves:
            (line,) = axes.plot(
                study.t, curve.values, color=curve.color, label=curve.label, linewidth=1.1,
                linestyle=DASHES[curve.dash],
            )  # fmt: skip
            if curve.label.split(" (")[0] not in {k.split(" (")[0] for k in entries}:
                entries[curve.label] = line
        if margin:
            forbid_negative(axes)
        else:
            axes.set_ylim(bottom=0.0)
    figure.legend(
        [*entries.values()], [*entries], loc="outside lower center", ncols=min(len(entries), 4)
    )
    return figure

"""What all plots of a run share: style, time axis, phases behind the curves, and PNG files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wbc.arrays import Array
from wbc.files import write_whole
from wbc.recording.log import Log
from wbc.recording.summary import phase_starts

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#6A51A3", "#4D4D4D")
"""Told apart also by colour-blind readers (after Okabe and Ito)."""
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.5)), (0, (6, 2, 1, 2)))
GREY = "#777777"
WARNING = "#B2182B"
FORBIDDEN = "#FFF3B0"

_BANDS = ("#F1F4F8", "#FFFFFF")
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 20.0,  # room for the names of the phases between title and axes
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "agg.path.chunksize": 20000,
}


@contextmanager
def style() -> Iterator[None]:
    """The house's style inside, the caller's again afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()  # whatever the user's own matplotlibrc says
        matplotlib.rcParams.update(_STYLE)
        yield


def panels(rows: int, columns: int, *, height: float = 3.0) -> tuple[Figure, list[Axes]]:
    """A figure of `rows` × `columns` axes, row by row, without pyplot and its global state.

    Args:
        height: of a row, [inch].
    """
    figure = Figure(figsize=(9.6, height * rows + 0.2), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    return figure, list(grid.ravel())


def save(figure: Figure, path: Path) -> Path:
    """Write the figure as PNG, whole or not at all; the same picture gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return write_whole(path, lambda file: file.write(picture.getvalue()))


def time_axis(
    axes: Axes, log: Log, title: str, ylabel: str, span: tuple[float, float] | None = None
) -> None:
    """Time along x from start to end of the run, phases shaded and named.

    Args:
        span: the part of the run that is shown, [s].
    """
    begin, end = (log.t[0], log.t[-1] + log.meta.dt) if span is None else span
    axes.set_title(title)
    axes.set_ylabel(ylabel)
    axes.set_xlabel("time [s]")
    axes.set_xlim(begin, end)
    starts = phase_starts(log)
    shown = np.append(log.t[starts[1:]], np.inf) > begin
    shown &= log.t[starts] < end
    starts = starts[shown]
    edges = [begin, *log.t[starts[1:]], end]
    names = [log.phase_names[p] for p in log.phase[starts]]
    for k in range(len(names)):
        axes.axvspan(edges[k], edges[k + 1], color=_BANDS[k % 2], zorder=-2, linewidth=0)
        if k:
            axes.axvline(edges[k], color="#AAB4C0", linewidth=0.7, zorder=-1)
    _name_phases(axes, names, edges)


def _name_phases(axes: Axes, names: Sequence[str], edges: Sequence[float]) -> None:
    """Names above the axes; one that would run into another goes a line up or is left out."""
    columns = axes.get_subplotspec()
    share = 1.0 / columns.get_gridspec().ncols if columns is not None else 1.0
    letter = (edges[-1] - edges[0]) / (150.0 * share)  # width of one, [s], on a page of 9.6 inch
    taken = [edges[0] - 10.0 * letter] * 2
    for k, name in enumerate(names):
        middle, half = 0.5 * (edges[k] + edges[k + 1]), 0.5 * letter * (len(name) + 1)
        line = next((n for n in range(2) if middle - half >= taken[n]), None)
        if line is None:
            continue
        taken[line] = middle + half
        axes.annotate(
            name.replace("_", " "), (middle, 1.0), xycoords=axes.get_xaxis_transform(),
            xytext=(0, 2 + 9 * line), textcoords="offset points", ha="center", va="bottom",
            fontsize=7.0, color="#556070",
        )  # fmt: skip


def log_axis(
    axes: Axes, values: Sequence[Array], *, most_decades: int = 14, least: float = 1e-16
) -> None:
    """A logarithmic y axis around `values`; zeros and what is not a number do not widen it.

    Args:
        most_decades: below the top; less is cut off.
        least: where rounding begins to be all there is.
    """
    known = np.concatenate([np.ravel(v) for v in values]) if values else np.zeros(0)
    known = known[np.isfinite(known) & (known > 0.0)]
    axes.set_yscale("log")
    if not len(known):
        axes.set_ylim(1e-12, 1.0)
        return
    top = 10.0 ** np.ceil(np.log10(known.max()) + 0.1)
    bottom = 10.0 ** np.floor(np.log10(known.min()) - 0.1)
    axes.set_ylim(min(max(bottom, top * 10.0**-most_decades, least), 0.1 * top), top)


def above_zero(values: Array) -> Array:
    """`values` with what a logarithmic axis cannot show left out."""
    return np.where(values > 0.0, values, np.nan)


def threshold(axes: Axes, value: float | None, label: str) -> None:
    """A dashed line at `value`, named at its right end, if the axes show it."""
    low, high = axes.get_ylim()
    if value is None or not low <= value <= high:
        return
    axes.axhline(value, color=WARNING, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.annotate(
        label, (1.0, value), xycoords=axes.get_yaxis_transform(), xytext=(-3, 2),
        textcoords="offset points", ha="right", va="bottom", fontsize=7.0, color=WARNING,
    )  # fmt: skip


def forbid_negative(axes: Axes) -> None:
    """Zero in the picture, and yellow what is below it."""
    low, high = axes.get_ylim()
    span = max(high, 0.0) - min(low, 0.0) or 1.0
    bottom = min(low, -0.06 * span)
    axes.set_ylim(bottom, max(high, 0.06 * span))
    axes.axhspan(bottom, 0.0, color=FORBIDDEN, linewidth=0, zorder=-0.5)
    axes.axhline(0.0, color=GREY, linewidth=0.7)

"""The plot of a run under torques: where the object truly went, forces and torques; Figure 16."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wbc.recording.dynamic_facts import normal_forces, object_error_true
from wbc.recording.figures import COLORS, DASHES, GREY, panels, time_axis
from wbc.recording.log import Log


def torques(log: Log) -> Figure:
    """True error of the object, normal forces and their errors, and how far joints are loaded."""
    figure, (position, angle, press, error, load) = panels(5, 1, height=1.9)
    way, turn = object_error_true(log)
    time_axis(position, log, "True position error of the object", "[mm]")
    position.plot(log.t, 1e3 * way, color=COLORS[0])
    time_axis(angle, log, "True orientation error of the object", "[mrad]")
    angle.plot(log.t, 1e3 * turn, color=COLORS[0])
    planned, measured = normal_forces(log)
    time_axis(press, log, "Normal forces, measured; thin: planned", "[N]")
    time_axis(error, log, "Normal force errors", "[N]")
    for i, name in enumerate(log.contact_names):
        color, dash = COLORS[i % len(COLORS)], DASHES[(i // len(COLORS)) % len(DASHES)]
        touching = log.in_contact[:, i]
        press.plot(log.t, measured[:, i], color=color, linestyle=dash, label=name)
        press.plot(log.t, np.where(touching, planned[:, i], np.nan), color=GREY, linewidth=0.6)
        off = np.where(touching, measured[:, i] - planned[:, i], np.nan)
        error.plot(log.t, off, color=color, linestyle=dash)
    limits = np.maximum(np.abs(np.array(log.meta.tau_min)), np.abs(np.array(log.meta.tau_max)))
    limited = len(limits) > 0 and bool(np.isfinite(limits).any())
    size = np.abs(log.tau) / limits if limited else np.abs(log.tau)
    label = "share of its limit [1]" if limited else "torque [Nm]"
    time_axis(load, log, "Joint that is loaded most", label)
    load.plot(log.t, np.max(size, axis=1, initial=0.0), color=COLORS[0])
    for axes in (position, angle, load):
        axes.set_ylim(bottom=0.0)
    figure.legend(
        *press.get_legend_handles_labels(), loc="outside lower center",
        ncols=min(max(len(log.contact_names), 1), len(COLORS)),
    )  # fmt: skip
    return figure

"""Plots of a run under torques: force errors, Figure 16, and how hard and how well it worked."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wbc.recording.dynamic_facts import normal_forces
from wbc.recording.figures import COLORS, DASHES, GREY, panels, time_axis
from wbc.recording.log import Log


def force_errors(log: Log) -> Figure:
    """Figure 16: measured less planned normal force of each finger in contact, and both forces."""
    figure, (error, press) = panels(2, 1, height=2.3)
    planned, measured = normal_forces(log)
    time_axis(error, log, "Normal force errors, measured less planned", "[N]")
    time_axis(press, log, "Normal forces, measured; thin: planned", "[N]")
    for i, name in enumerate(log.contact_names):
        color, dash = COLORS[i % len(COLORS)], DASHES[(i // len(COLORS)) % len(DASHES)]
        touching = log.in_contact[:, i]
        off = np.where(touching, measured[:, i] - planned[:, i], np.nan)
        error.plot(log.t, off, color=color, linestyle=dash, label=name)
        press.plot(log.t, measured[:, i], color=color, linestyle=dash)
        press.plot(log.t, np.where(touching, planned[:, i], np.nan), color=GREY, linewidth=0.6)
    figure.legend(
        *error.get_legend_handles_labels(), loc="outside lower center",
        ncols=min(max(len(log.contact_names), 1), len(COLORS)),
    )  # fmt: skip
    return figure


def torques(log: Log) -> Figure:
    """How far joints are loaded, how far they are from where they should be, and slip."""
    figure, (load, behind, slip) = panels(3, 1, height=1.9)
    limits = np.maximum(np.abs(np.array(log.meta.tau_min)), np.abs(np.array(log.meta.tau_max)))
    limited = len(limits) > 0 and bool(np.isfinite(limits).any())
    size = np.abs(log.tau) / limits if limited else np.abs(log.tau)
    label = "share of its limit [1]" if limited else "torque [Nm]"
    time_axis(load, log, "Joint that is loaded most", label)
    load.plot(log.t, np.max(size, axis=1, initial=0.0), color=COLORS[0])
    time_axis(behind, log, "Joint that is furthest from its reference", "[mrad] ([mm])")
    away = 1e3 * np.abs(log.q_meas - log.q)
    behind.plot(log.t, np.max(away, axis=1, initial=0.0), color=COLORS[0])
    time_axis(slip, log, "Slip of the fingers that hold", "[mm]")
    for i, name in enumerate(log.contact_names):
        color, dash = COLORS[i % len(COLORS)], DASHES[(i // len(COLORS)) % len(DASHES)]
        slip.plot(log.t, 1e3 * log.slip[:, i], color=color, linestyle=dash, label=name)
    for axes in (load, behind, slip):
        axes.set_ylim(bottom=0.0)
    figure.legend(
        *slip.get_legend_handles_labels(), loc="outside lower center",
        ncols=min(max(len(log.contact_names), 1), len(COLORS)),
    )  # fmt: skip
    return figure

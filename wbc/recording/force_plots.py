"""The plot of the contact forces that a run planned."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wbc.forces import ForceStatus
from wbc.recording.figures import (
    COLORS,
    DASHES,
    WARNING,
    forbid_negative,
    panels,
    time_axis,
)
from wbc.recording.log import Log


def forces(log: Log) -> Figure:
    """The forces of the run itself: how hard each contact presses, margins, verdicts, effort."""
    figure, axes_list = panels(4, 1, height=1.9)
    press, cones, torques, effort = axes_list
    time_axis(press, log, "Planned contact forces", "‖force‖ [N]")
    size = np.linalg.norm(log.contact_force_plan, axis=2)
    for i, name in enumerate(log.contact_names):
        press.plot(
            log.t, np.where(log.in_contact[:, i], size[:, i], np.nan), label=name,
            color=COLORS[i % len(COLORS)], linestyle=DASHES[(i // len(COLORS)) % len(DASHES)],
        )  # fmt: skip
    press.set_ylim(bottom=0.0)
    for axes, values, title, label in (
        (cones, log.cone_margin, "Smallest margin of a friction cone", "$c_z - |s|$ [N]"),
        (torques, log.torque_margin, "Smallest distance to a torque limit", "[Nm]"),
    ):
        time_axis(axes, log, title, label)
        least = np.min(values, axis=1, initial=np.inf, where=~np.isnan(values))
        axes.plot(log.t, np.where(np.isfinite(least), least, np.nan), color=COLORS[0])
        forbid_negative(axes)
    time_axis(effort, log, "Newton steps per tick", "steps [1]")
    effort.plot(log.t, log.force_iterations, color=COLORS[0], drawstyle="steps-post")
    effort.set_ylim(bottom=0.0)
    usable = np.array([status.usable for status in ForceStatus])[log.force_status]
    for index, status in enumerate(ForceStatus):
        if not status.usable and (log.force_status == index).any():
            for axes in axes_list:
                axes.fill_between(
                    log.t, 0.0, 1.0, where=(log.force_status == index).tolist(), color=WARNING,
                    alpha=0.15, linewidth=0, transform=axes.get_xaxis_transform(),
                    label=status.value.replace("_", " ") if axes is effort else None,
                )  # fmt: skip
    if not usable.all():
        effort.legend(loc="upper right")
    figure.legend(
        *press.get_legend_handles_labels(), loc="outside lower center",
        ncols=min(len(log.contact_names), len(COLORS)),
    )  # fmt: skip
    return figure

"""A controller that goes through its phases quickly: long ticks, and exits that those can meet."""

from __future__ import annotations

import math
from dataclasses import replace

from wbc.control.controller import Controller
from wbc.control.phases import ExitCondition, Phase, PhaseSequence

REACHED = 1e-3
"""What counts as reached, [m]."""

_RESIDUAL = 1e-3  # what counts as balanced, in the task's units
_SHARE = 0.5  # of an error that one tick may take away at the highest gain
_ENDLESS = 5.0  # after its motion, a phase without timeout is given so long, [s]


def coarse_controller(controller: Controller, tick: float) -> Controller:
    """The same with long ticks, and with phases that long ticks can finish.

    Args:
        tick: [s]; shorter where gains are so high that it would not be stable.
    """
    phases = PhaseSequence(tuple(_coarse(phase) for phase in controller.phases.phases))
    gain = max([controller.law.kin.gain, *controller.law.stack.gain.tolist()])
    if gain > 0.0:
        tick = min(tick, max(_SHARE / gain, controller.settings.dt))
    settings = replace(controller.settings, dt=tick, runge_kutta=False)
    return controller.like(phases, settings)


def _coarse(phase: Phase) -> Phase:
    """The same phase with exit conditions that a long tick can meet, and an end in any case."""
    until = phase.until
    if math.isinf(until.time):
        until = ExitCondition(time=phase.over)
    if until.touch is not None:  # the ideal robot feels the surface where it is believed
        until = replace(until, tip_error=REACHED)
    until = replace(
        until,
        touch=None,
        press=None,
        residuals=tuple((task, max(limit, _RESIDUAL)) for task, limit in until.residuals),
        tip_error=None if until.tip_error is None else max(until.tip_error, REACHED),
        object_error=None if until.object_error is None else max(until.object_error, REACHED),
        force_closure=None if until.force_closure is None else max(until.force_closure, _RESIDUAL),
    )
    patience = phase.timeout
    if math.isinf(patience):
        patience = max(until.time, phase.over) + _ENDLESS
    return replace(phase, until=until, timeout=patience, on_timeout="stop", search=0.0)

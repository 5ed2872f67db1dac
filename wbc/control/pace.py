"""How fast the references go: from their own speed down to a stand and back, smoothly.

A pace p in [0, 1] is the speed of the phases' own time. What p leaves out is added to the time at
which the phase and its motion began, so that references, exit conditions and timeouts all wait.
"""

from __future__ import annotations

from wbc.control.state import PhaseState


def paced(phase: PhaseState, t: float, dt: float, pace: float) -> PhaseState:
    """The phase as a tick at time t begins, its references at a pace from now on.

    At pace 1 throughout it is the phase itself.

    Args:
        t, dt: the tick [s].
        pace: share of their speed with which the references move over the tick; brought into
            [0, 1], NaN to 0.
    """
    motion = phase.motion
    pace = min(1.0, max(0.0, pace))  # in this order, of 0 and NaN `max` takes 0
    if pace == motion.pace == 1.0 and motion.quickening == 0.0:
        return phase
    lost = (1.0 - motion.pace) * (t - motion.now)
    motion = motion._replace(
        start=motion.start + lost, pace=pace, now=t, quickening=(pace - motion.pace) / dt
    )
    return phase._replace(since=phase.since + lost, motion=motion)


def stride(pace_at: float, wanted: float, dt: float, ramp: float) -> float:
    """The next share of the way from a stand to full speed; see `pace_of`.

    Args:
        pace_at: the last one, in [0, 1].
        wanted: where it is to go.
        ramp: time from a stand to full speed [s].
    """
    step = dt / ramp
    return min(max(wanted, pace_at - step), pace_at + step)


def pace_of(share: float) -> float:
    """Pace for a share of the way, both in [0, 1]: a smooth step, exactly 0 and 1 at its ends."""
    return share * share * (3.0 - 2.0 * share)

"""The limit filter: what the stack wants, within what the robot may do, reported.

A cost cannot guarantee a limit. After the stack, every joint has an interval of velocities from
which its position and velocity limits can still be kept, braking distance included. A command
outside is first stripped of its secondary part, as far as needed, keeping the main task's
direction and speed; if the main task alone does not fit it is slowed along its direction. A change
faster than the acceleration limits is made along the straight line from the last command, all
joints in proportion: both ends fulfil the main task, so every point between does. What is still
outside (a start beyond a limit, a joint that must brake now) is clipped joint by joint.

From a state from which the limits can be kept they are, all three, whatever is demanded: a joint
always has room to brake, and clipping it never asks for more than its deceleration. From any other
state positions and velocities come first and the acceleration gives way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel

# What a command may be outside its bounds, relative to 1 + its size, and still count as inside: a
# joint at its bound or locked, and asked for a rounding error, must not stop all others.
_ROUNDING = 1e-9


class Limited(NamedTuple):
    """What the filter did.

    Attributes:
        secondary: share of the secondary motion kept, 1 = all.
        main: share of the main task's speed kept, 1 = all.
        change: share of the change since the last command that was made, 1 = all.
        clipped: whether joints had to be clipped one by one (the main task's direction is lost).
        joint: the joint that bound most, -1 if none did.
    """

    secondary: float
    main: float
    change: float
    clipped: bool
    joint: int


NOT_LIMITED = Limited(1.0, 1.0, 1.0, False, -1)


class Bounds(NamedTuple):
    """Limits of n coordinates.

    Attributes:
        lower, upper: (n,) of the position, -inf and inf where there are none.
        velocity: (n,) may be inf.
        acceleration: (n,) largest change of a velocity per time; may be inf.
        braking: (n,) deceleration that a position limit is approached with; may be inf.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    braking: Array


@kernel
def velocity_bounds(
    q: Array, lower: Array, upper: Array, velocity: Array, braking: Array, dt: float,
    low: Array, high: Array,
) -> None:  # fmt: skip
    """Velocities of the next tick that keep position and velocity limits now and by braking later.

    Beyond a bound only motion back is allowed.

    Args:
        q: (n,) positions.
        lower, upper, velocity: (n,) limits; positions may be unlimited, -inf and inf.
        braking: (n,) deceleration, inf where any will do.
        dt: the tick, [s].
        low, high: (n,) filled, low <= 0 <= high.
    """
    for j in range(q.shape[0]):
        high[j] = min(velocity[j], _approach(upper[j] - q[j], braking[j], dt))
        low[j] = -min(velocity[j], _approach(q[j] - lower[j], braking[j], dt))


@kernel
def _approach(room: float, a: float, dt: float) -> float:
    """Largest velocity of the next tick from which a joint stops within `room`, losing a dt a tick.

    From v = (n + r) a dt with n whole and 0 <= r < 1 the ticks to come take it over
    v dt + (v − a dt) dt + … = ((n + 1)(n + r) − n (n + 1) / 2) a dt²; solved for v.
    """
    step = a * dt * dt
    if room <= 0.0 or step <= 0.0:
        return 0.0
    if np.isinf(step) or np.isinf(room):
        return room / dt
    steps = room / step
    n = float(np.floor(0.5 * (np.sqrt(1.0 + 8.0 * steps) - 1.0)))
    return a * dt * (steps / (n + 1.0) + 0.5 * n)


@kernel
def _fit(start: Array, step: Array, low: Array, high: Array) -> tuple[float, int]:
    """Largest s in [0, 1] with start + s step inside the bounds, and the joint that stops it.

    A joint whose start is outside already does not stop it: clipping is left to deal with it. One
    at its bound is not outside, whatever rounding made of that.
    """
    s = 1.0
    joint = -1
    for j in range(start.shape[0]):
        end = start[j] + step[j]
        slack = _ROUNDING * (1.0 + abs(end))
        near = _ROUNDING * (1.0 + abs(start[j]))
        if end > high[j] + slack and start[j] <= high[j] + near:
            share = (high[j] - start[j]) / step[j]
        elif end < low[j] - slack and start[j] >= low[j] - near:
            share = (low[j] - start[j]) / step[j]
        else:
            continue
        if share < s:
            s = max(share, 0.0)
            joint = j
    return s, joint


@kernel
def limit(
    v_main: Array, v: Array, last: Array, low: Array, high: Array, acceleration: Array, dt: float,
    out: Array,
) -> tuple[float, float, float, bool, int]:  # fmt: skip
    """Fill out (n,) with the command.

    Args:
        v_main, v: (n,) the main task's motion and the whole law's.
        last: (n,) the last command.
        low, high: (n,) from `velocity_bounds`.
        acceleration: (n,), inf where there is none.

    Returns:
        The fields of `Limited`.
    """
    return limit_from(last, v_main, v, last, low, high, acceleration, dt, out)[:5]


@kernel
def limit_from(
    anchor: Array, v_main: Array, v: Array, last: Array, low: Array, high: Array,
    acceleration: Array, dt: float, out: Array,
) -> tuple[float, float, float, bool, int, float]:  # fmt: skip
    """`limit`, where a change that does not fit goes from the last command to `anchor` first.

    Args:
        anchor: (n,) the velocity nearest to the last command that does what the main task wants
            now; the last command itself where that is not known.

    Returns:
        The fields of `Limited`, and the share of the way to the anchor that fits.
    """
    n = v.shape[0]
    zero = np.zeros(n)
    out[:] = v
    main, secondary = 1.0, 1.0
    joint = -1
    if _fit(zero, v, low, high)[1] >= 0:
        main, joint = _fit(zero, v_main, low, high)
        if main == 1.0:
            secondary, joint = _fit(v_main, v - v_main, low, high)
        else:
            secondary = 0.0
        out[:] = main * v_main + secondary * (v - v_main)
    reach = acceleration * dt
    least, most = np.maximum(last - reach, low), np.minimum(last + reach, high)
    kept, change = 1.0, 1.0
    if _fit(last, out - last, least, most)[1] >= 0:
        kept, slow = _fit(last, anchor - last, least, most)
        begin = last + kept * (anchor - last)
        change, slowest = _fit(begin, out - anchor, least, most)
        if kept < 1.0 or change < 1.0:
            joint = slowest if slowest >= 0 else slow
            out[:] = begin + change * (out - anchor)
    clipped = False
    for j in range(n):
        inside = min(max(out[j], last[j] - reach[j]), last[j] + reach[j])
        inside = min(max(inside, low[j]), high[j])  # position and velocity limits come first
        if abs(inside - out[j]) > _ROUNDING * (1.0 + abs(out[j])):
            clipped = True
            joint = j
        out[j] = inside
    return secondary, main, change, clipped, joint, kept


@kernel
def stuck(
    q: Array, v: Array, lower: Array, upper: Array, velocity: Array, braking: Array,
    dt: float, free: Array,
) -> bool:  # fmt: skip
    """Set free (n,) to 0 for the joints that v would drive on into a limit they stand at.

    What the other arrays hold beyond n entries is passed over.

    A joint stands at a limit when its position leaves it no more than one tick's braking, or when
    it may not move at all. Locked, it leaves the motion to the joints that can still move, instead
    of stopping them all with it.

    Returns:
        Whether a joint was locked that was free before.
    """
    found = False
    for j in range(free.shape[0]):
        brake = braking[j] * dt if np.isfinite(braking[j]) else 0.0
        high = _approach(upper[j] - q[j], braking[j], dt)
        low = _approach(q[j] - lower[j], braking[j], dt)
        at_limit = (v[j] > high and high <= brake) or (-v[j] > low and low <= brake)
        if velocity[j] == 0.0:
            at_limit = v[j] != 0.0
        if free[j] == 1.0 and at_limit:
            free[j] = 0.0
            found = True
    return found


@kernel
def speed_shares(main: Array, total: Array, velocity: Array) -> tuple[float, float]:
    """Shares of the main and the secondary motion that velocity limits (n,) leave, 1 = all.

    Args:
        main, total: (>= n,) the main task's motion and the whole law's; passive rates behind.
    """
    n = velocity.shape[0]
    zero = np.zeros(n)
    for j in range(n):
        if not abs(total[j]) <= velocity[j]:
            break
    else:
        return 1.0, 1.0
    share = _fit(zero, main[:n], -velocity, velocity)[0]
    if share < 1.0:
        return share, 0.0
    return 1.0, _fit(main[:n], total[:n] - main[:n], -velocity, velocity)[0]


@kernel
def filtered(
    q: Array, main: Array, total: Array, last: Array, lower: Array, upper: Array, velocity: Array,
    acceleration: Array, braking: Array, dt: float,
) -> tuple[Array, tuple[float, float, float, bool, int]]:  # fmt: skip
    """The whole filter: `velocity_bounds`, then `limit`.

    Returns:
        The command (n,), and the fields of `Limited`.
    """
    n = q.shape[0]
    low, high, out = np.empty(n), np.empty(n), np.empty(n)
    velocity_bounds(q, lower, upper, velocity, braking, dt, low, high)
    return out, limit(main, total, last, low, high, acceleration, dt, out)

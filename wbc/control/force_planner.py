"""The contact forces of every tick: how hard each finger presses while the object moves as planned.

The forces balance what motion and weight of the object ask for, stay in the friction cones, and ask
no joint for more than its torque limit (1)-(5). Which contacts may carry is up to the phase; from
one set of contacts to the next the forces pass without a step, see `Passage`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode
from wbc.control.hand_statics import Touches, loads, statics, touches
from wbc.control.load_estimate import LoadEstimate, LoadState
from wbc.control.numbers import given
from wbc.control.payload import Body, Payload, wrench_to_supply
from wbc.control.phases import Phase
from wbc.control.references import minimum_jerk, object_acceleration
from wbc.control.state import ControllerState, ForceRecord, ForceState, Measurement, PhaseState
from wbc.forces import POINT, SOFT_FINGER, ForceStatus, GraspForceProblem
from wbc.forces.solver import ForceSolver, ForceStep
from wbc.robot.dynamics import InverseDynamics
from wbc.robot.kinematics import Kinematics

_STATUS: Final = {status: k for k, status in enumerate(ForceStatus)}
_RANK: Final = np.array([0, 2, 1])  # of modes, by what they can carry; its own inverse


@dataclass(frozen=True)
class ForceSettings:
    """What the planner may ask of contacts and joints.

    Attributes:
        soft: contacts also take a moment about their normal.
        mu: (N,) friction of contacts that hold.
        mu_t: (N,) torsional friction [m]; not used unless `soft`.
        sliding: friction of contacts while they slide. Coulomb's force of a sliding tip is along
            its motion and not the planner's to choose; with a small cone it all but presses.
        tau_min, tau_max: (nv,) torque limits [Nm], both inf where there is none.
        w_p, w_bF, w_bT: weights of (15)-(16).
        margin: part of c_z to a cone, or of half a torque range to a limit, that must be left for
            a plan not to be `LOW_MARGIN`.
        method: "newton", or "exact" for the least forces to the very limits.
        ramp: [s] for the forces to pass from one set of contacts to the next.
        estimate: of what is carried, from measured forces; None: it is as believed.
    """

    soft: bool
    mu: Array
    mu_t: Array
    sliding: float
    tau_min: Array
    tau_max: Array
    w_p: float
    w_bF: float
    w_bT: float
    margin: float
    method: Literal["newton", "exact"]
    ramp: float
    estimate: LoadEstimate | None = None


class Passage(NamedTuple):
    """How forces pass through a phase: c = (1 − a) c_before + a (1 − b) c_own + a b c_after.

    Each of the three balances the object alone, on contacts that this phase has: `before` and
    `after` are the modes that it shares with the phases before and after, of a contact's two modes
    the one that carries less. Cones and torque limits are convex and the balance is linear, so
    every mixture is feasible with them. a and b go from 0 to 1 at the phase's beginning and before
    its motions end; where a neighbour shares no contact, or all, there is nothing to pass. Where
    the phase before has no contact at all and something else bears an object that rests in this
    one, c_before is none: that, a table, goes on with 1 − a of the load.

    Attributes:
        before, own, after: indices of sets of contacts; -1: no contact.
        ramps: how many of a and b there are, 0 to 2.
    """

    before: int
    own: int
    after: int

    @property
    def ramps(self) -> int:
        """How many of the two passages there are."""
        return (self.before != self.own) + (self.after != self.own)

    def weights(self, elapsed: float, over: float, ramp: float) -> dict[int, float]:
        """The part of each set at a time since the phase began, [s]; those that are positive.

        They sum to one, to less while something else bears the rest.
        """
        ramp = min(ramp, over / max(self.ramps, 1))
        a = 1.0 if self.before == self.own else minimum_jerk(elapsed / ramp)[0]
        b = 0.0 if self.after == self.own else minimum_jerk((elapsed - over) / ramp + 1.0)[0]
        found: dict[int, float] = {}
        for k, weight in (
            (self.before, 1.0 - a), (self.own, a * (1.0 - b)), (self.after, a * b),
        ):  # fmt: skip
            if weight > 0.0 and k >= 0:
                found[k] = found.get(k, 0.0) + weight
        return found


def passages(phases: Sequence[Phase]) -> tuple[list[IntArray], list[Passage]]:
    """Sets of contacts (N,) that are planned for, and how each phase goes through them."""
    modes = [phase.mode for phase in phases]
    sets: list[IntArray] = []

    def index(mode: IntArray) -> int:
        if not mode.any():
            return -1
        for k, known in enumerate(sets):
            if np.array_equal(known, mode):
                return k
        sets.append(mode)
        return len(sets) - 1

    def shared(k: int, other: int) -> int:
        if not 0 <= other < len(modes):
            return index(modes[k])
        both = index(_RANK[np.minimum(_RANK[modes[k]], _RANK[modes[other]])])
        return both if both >= 0 else index(modes[k])

    found = []
    for k, phase in enumerate(phases):
        first = k > 0 and not modes[k - 1].any() and phase.borne
        before = -1 if first and phase.object_motion is None else shared(k, k - 1)
        found.append(Passage(before, index(phase.mode), shared(k, k + 1)))
    return sets, found


@final
class _Hold:
    """One set of contacts, with its solver: the sparsity of J is that of the kinematic tree."""

    def __init__(self, kin: ExtendedKinematics, settings: ForceSettings, mode: IntArray) -> None:
        self.fingers: IntArray = np.flatnonzero(mode)
        model, tips = kin.robot.model, [kin.robot.frames[i] for i in self.fingers]
        chains: BoolArray = np.array([model.support(model.frame(tip)) for tip in tips]) > 0.0
        self.joints: IntArray = np.flatnonzero(chains.any(axis=0))
        m = 4 if settings.soft else 3
        slides = mode[self.fingers] == ContactMode.SLIDING
        size = m * len(self.fingers)
        self.problem = GraspForceProblem(
            G=np.zeros((6, size)),
            J=np.zeros((size, len(self.joints))),
            tau_e=np.zeros(len(self.joints)),
            tau_min=settings.tau_min[self.joints],
            tau_max=settings.tau_max[self.joints],
            mu=np.where(slides, settings.sliding, settings.mu[self.fingers]),
            mu_t=settings.mu_t[self.fingers] if settings.soft else None,
            model=SOFT_FINGER if settings.soft else POINT,
            h_e=np.zeros(6),
            w_p=settings.w_p,
            w_bF=settings.w_bF,
            w_bT=settings.w_bT,
        )
        self.solver = ForceSolver(
            self.problem, moves=chains[:, self.joints].T, margin=settings.margin
        )
        self.width = m
        self.exact = settings.method == "exact"

    def at(
        self, robot: Kinematics, touch: Touches, tau_e: Array, wrench: Array
    ) -> tuple[Array, Array, Array, Array]:
        """G, J, τ_e and h_e of a tick."""
        g, j = statics(robot, touch, self.fingers, self.joints, self.width == 4)
        return g, j, tau_e[self.joints], wrench

    def solve(self, given: tuple[Array, Array, Array, Array], start: Array | None) -> ForceStep:
        """Verdict, c, Φ and iterations, from a start that need not balance any more.

        Where the exact method misses its certificate, Newton's plan: it keeps every limit.
        """
        if self.exact:
            step = self.solver.exact(*given)
            if step.status is not ForceStatus.NOT_BALANCED:
                return step
        return self.solver.solve(*given, start)


class _Plan(NamedTuple):
    """The solutions of a tick, mixed.

    Attributes:
        c: (N, 4) in the contact frames; None: no set could be balanced.
        status: the gravest verdict of the sets that were mixed; of those asked if none could be.
        starts, iterations, phi: as they go on and into the record.
        balanced: whether all sets asked for could be.
    """

    c: Array | None
    status: ForceStatus
    starts: tuple[Array | None, ...]
    iterations: int
    phi: float
    balanced: bool


@final
class ForcePlanner:
    """Plans the contact forces of a controller's ticks; holds no state between them.

    Attributes:
        payload: what the fingers carry.
        settings: what may be asked of contacts and joints.
    """

    def __init__(
        self, kin: ExtendedKinematics, payload: Payload, settings: ForceSettings,
        phases: tuple[Phase, ...], dt: float,
    ) -> None:  # fmt: skip
        self.payload = payload
        self.settings = settings
        self._sets, self._passages = passages(phases)
        self._holds = [_Hold(kin, settings, mode) for mode in self._sets]
        self._dynamics = InverseDynamics(kin.robot.model)
        self._dt = dt
        self._limits = settings.tau_min, settings.tau_max
        ones = np.ones(kin.grasp.count)
        slides = [phase.mode == ContactMode.SLIDING for phase in phases]
        self._friction = [
            (np.where(s, settings.sliding, settings.mu), settings.mu_t if settings.soft else ones)
            for s in slides
        ]

    def plan(
        self, kin: ExtendedKinematics, t: float, state: ControllerState,
        measurement: Measurement | None = None,
    ) -> tuple[ForceRecord, ForceState]:  # fmt: skip
        """The forces at t, where `kin` has been updated. Never raises on numbers, never NaN.

        A tick without feasible forces holds the last ones, and its status says why: they need not
        balance, nor be inside all limits, where the hand is now, and the margins say by how much.

        Args:
            state: with the velocity commanded up to t, and the plan of the tick before.
            measurement: of which the forces at the tips count; whatever is not one is none.
        """
        phase, v, last = state.phase, state.v, state.forces
        if last is None:
            last = ForceState(v, np.zeros((kin.grasp.count, 4)), (None,) * len(self._holds))
        mode, gravity = kin.state.mode, self._dynamics.gravity
        touch = touches(kin)
        found = given(measurement, "force")
        body, load = self._carried(kin, t, phase, touch, last.load, found)
        wrench, com = wrench_to_supply(
            body, kin.object_rotation, kin.reference.twist, object_acceleration(t, phase.motion),
            gravity,
        )  # fmt: skip
        tau_e = self._dynamics.torques(kin.robot.q, v, (v - last.v) / self._dt)
        weights = self._passages[phase.current].weights(
            t - phase.since, phase.motion.duration, self.settings.ramp
        )
        plan = self._solved(kin.robot, touch, tau_e, wrench, weights, last)
        wrench = min(1.0, sum(weights.values())) * wrench
        held = mode != ContactMode.FREE
        c = np.where(held[:, None], last.c, 0.0) if plan.c is None else plan.c
        out = loads(kin.robot, touch, mode, c, tau_e, self._friction[phase.current], self._limits)
        record = ForceRecord(
            force=out.force, spin=c[:, 3].copy(), torque=out.torque, cone_margin=out.cone_margin,
            torque_margin=out.torque_margin, wrench=wrench, mass=body.mass,
            com=kin.object_position + com, status=_STATUS[plan.status], iterations=plan.iterations,
            phi=plan.phi, sum_normal=float(c[:, 2].sum()),
        )  # fmt: skip
        if plan.status is ForceStatus.INVALID_INPUT:
            record = _finite(record, held)
        return record, ForceState(v, c, plan.starts, load, plan.balanced)

    def at_rest(
        self, kin: ExtendedKinematics, t: float, phase: PhaseState
    ) -> tuple[ForceStatus, float]:
        """Whether the contacts of a phase hold the object still where `kin` has been updated.

        Returns:
            The verdict, and how many times the weight they hold; NaN where the joints do not even
            carry the robot, or the contacts not every load.
        """
        own, gravity, none = self._passages[phase.current].own, self._dynamics.gravity, np.zeros(6)
        if own < 0:
            return ForceStatus.SOLVED, np.inf
        body = self.payload.body(kin.object_rotation, gravity, self._water(t, phase))
        wrench, _ = wrench_to_supply(body, kin.object_rotation, none, none, gravity)
        still = np.zeros(len(kin.robot.q))
        hold, tau_e = self._holds[own], self._dynamics.torques(kin.robot.q, still, still)
        given = hold.at(kin.robot, touches(kin), tau_e, wrench)
        return hold.solver.inside(*given).status, hold.solver.load_factor(*given)

    def problem(
        self, robot: Kinematics, mode: IntArray, touch: Touches, v: Array, a: Array, wrench: Array
    ) -> GraspForceProblem:
        """What a tick asked of all its contacts; during a passage the plan lies between this and
        the sets on either side of it.

        From a log: `robot` updated at `q`, `mode` from `contact_mode`, `touch` by
        `wbc.control.hand_statics.touches_at` from `contact_points` and `contact_normals`, `v` that
        of the tick before, `a` its change since the one before that over dt, `wrench` from
        `wrench_plan`. The tangents of the contacts differ from the planner's then; the cones are
        round, so that forces in the world and all margins are the same.

        Args:
            robot: fresh; tracked frame i is finger i's tip.
            mode: (N,) ContactMode; at least one finger must not be free.
            v, a: (nv,) velocity and acceleration of the joints.
            wrench: (6,) h_e about the object's origin.
        """
        known = (k for k, mine in enumerate(self._sets) if np.array_equal(mine, mode))
        hold = self._holds[next(known)]
        tau_e = self._dynamics.torques(robot.q, v, a)
        g, j, own_tau_e, h_e = hold.at(robot, touch, tau_e, wrench)
        return hold.problem.with_(G=g, J=j, tau_e=own_tau_e, h_e=h_e)

    def _carried(
        self, kin: ExtendedKinematics, t: float, phase: PhaseState, touch: Touches,
        load: LoadState | None, found: Array | None,
    ) -> tuple[Body, LoadState | None]:  # fmt: skip
        """The object with its contents as it is believed, or as measured forces say, and the
        estimate's state: it stands still while contacts join or leave, for the points of those are
        not yet, or no longer, where they are believed."""
        rotation, gravity = kin.object_rotation, self._dynamics.gravity
        believed = self.payload.body(rotation, gravity, self._water(t, phase))
        estimate = self.settings.estimate
        if estimate is None:
            return believed, None
        load = estimate.init() if load is None else load
        if phase.current >= estimate.phase and self._passages[phase.current].ramps == 0:
            load = estimate.updated(
                load, believed, found, touch.arm, rotation, kin.reference.twist,
                object_acceleration(t, phase.motion), gravity, self._dt,
            )  # fmt: skip
        return estimate.body(believed, load), load

    def _water(self, t: float, phase: PhaseState) -> float:
        """What is left in the object, [kg]."""
        water = self.payload.water
        if water is None:
            return 0.0
        return water.mass_at(t, phase.current, phase.since, phase.motion.duration)

    def _solved(
        self, robot: Kinematics, touch: Touches, tau_e: Array, wrench: Array,
        weights: dict[int, float], last: ForceState,
    ) -> _Plan:  # fmt: skip
        """All sets of a tick, each warm from its last solution; what is feasible, mixed."""
        starts: list[Array | None] = [None] * len(self._holds)
        c = np.zeros_like(last.c)
        iterations, phi, total = 0, 0.0, 0.0
        good, bad = [ForceStatus.SOLVED], list[ForceStatus]()
        for k, weight in weights.items():
            hold = self._holds[k]
            step = hold.solve(hold.at(robot, touch, tau_e, wrench), last.starts[k])
            iterations += step.iterations
            (good if step.status.usable else bad).append(step.status)
            if not step.status.usable:
                starts[k] = last.starts[k]
                continue
            starts[k] = step.c
            c[hold.fingers, : hold.width] += weight * step.c.reshape(-1, hold.width)
            phi += weight * step.phi
            total += weight
        if weights and total == 0.0:
            return _Plan(
                None, max(bad, key=_STATUS.__getitem__), tuple(starts), iterations, np.inf, False
            )
        part = sum(weights.values()) / total if weights else 1.0
        status = max(good, key=_STATUS.__getitem__)
        return _Plan(part * c, status, tuple(starts), iterations, part * phi, not bad)


def _finite(record: ForceRecord, held: BoolArray) -> ForceRecord:
    """A record of numbers only, but for the cones of free fingers; 0 for what is none."""
    clean = {
        name: np.nan_to_num(getattr(record, name), posinf=np.inf, neginf=-np.inf)
        for name in ("force", "torque", "cone_margin", "torque_margin", "wrench", "com")
    }
    clean["cone_margin"][~held] = np.nan
    return record._replace(mass=float(np.nan_to_num(record.mass)), **clean)

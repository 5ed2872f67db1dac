"""The comparisons of section 1.5: a sequence of ticks through every variant of Figures 4 to 10.

Figure 4 shows `c`, 5 and 9 the smallest `torque_margin`, 6 and 8 the norms of `c` and `tau`, 7
`percent` and `active`, 10 `share`, `load_force` and `load_moment`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.forces import cost
from wbc.forces.blocks import find_blocks, pattern
from wbc.forces.flow_kernels import DONE, Fixed, Tick, assemble, fixed, tick
from wbc.forces.flows import METHODS, MOST, TOLERANCE
from wbc.forces.inside import pack
from wbc.forces.problem import GraspForceProblem
from wbc.forces.selection import active_after, tracked_selected
from wbc.forces.solver import OPTIMUM, answer
from wbc.forces.split import by_component, common_point, rooms, tracked_split


@final
@dataclass(frozen=True)
class Case:
    """A variant.

    Attributes:
        limits: with the torque limits, or with friction alone.
        sigma: threshold σ_τ of the selection; None: all bounds are in the cost.
        split: each hand on its own; sigma is not used then.
        weighted: with (22)-(23).
        method: ``"flow18"``, ``"flow19"``, ``"flow20"``; or ``"newton"``, the solver of
            `wbc.forces.solver` on the same bounds.
    """

    name: str
    limits: bool = True
    sigma: float | None = None
    split: bool = False
    weighted: bool = False
    method: str = "flow18"


_SOLVED = 0  # what `wbc.forces.solver.answer` says

ALL = Case("all")
CASES = (
    ALL,
    Case("sigma 0", sigma=0.0),
    Case("sigma 0.5", sigma=0.5),
    Case("sigma 0.8", sigma=0.8),
    Case("none", limits=False),
    Case("split", split=True),
    Case("split weighted", split=True, weighted=True),
)
"""Those of Figure 7."""


class CaseRun(NamedTuple):
    """A variant's way through T ticks; a tick that fails holds the forces of the one before.

    Attributes:
        c: (T, M) contact forces, [N], [Nm].
        tau: (T, l) joint torques, [Nm].
        cone_margin: (T, n) distance to the friction cones, [N].
        torque_margin: (T, l) distance to the limits, also where the variant has none, [Nm].
        phi: (T,) the cost (15), of friction alone where the variant has no limits.
        seconds: (T,) time of the solve by the clock given.
        steps: (T,) steps of the method.
        active: (T,) torque bounds in the cost.
        solved: (T,) whether the tick was solved.
        share: (T, H) load-sharing coefficients δ_h / Σ δ at the start of the tick.
        load_force: (T, H) norm of the force that a hand exerts on the object, [N].
        load_moment: (T, H) norm of its moment about the origin of G, [Nm].
    """

    c: Array
    tau: Array
    cone_margin: Array
    torque_margin: Array
    phi: Array
    seconds: Array
    steps: IntArray
    active: IntArray
    solved: BoolArray
    share: Array
    load_force: Array
    load_moment: Array


def run(
    problems: Iterable[GraspForceProblem], start: Array, hands: IntArray,
    *, cases: Iterable[Case] = CASES, tolerance: float = TOLERANCE, most: int = MOST,
    clock: Callable[[], float] | None = None, repeats: int = 1,
) -> dict[str, CaseRun]:  # fmt: skip
    """Every case through all problems, one tick of each case after the other.

    Args:
        problems: one a tick; contacts, limits and weights stay.
        start: (M,) forces that balance the first one inside all limits.
        hands: (n,) the hand of each contact, from 0.
        tolerance, most: as in `wbc.forces.flows.flow18`; Newton has its own.
        clock: seconds, e.g. ``time.thread_time``, taken around the compiled solve; None: seconds
            are 0.
        repeats: the shortest of so many solves of a tick counts; the first of a variant finds the
            processor's memories full of another's code.
    """
    courses: dict[str, _Course] = {}
    cases = tuple(cases)
    for problem in problems:
        for case in cases:
            if case.name not in courses:
                courses[case.name] = _Course(case, problem, start, hands)
            courses[case.name].step(problem, tolerance, most, clock or _no_clock, repeats)
    return {name: course.result() for name, course in courses.items()}


def percent(runs: dict[str, CaseRun], name: str, of: str = ALL.name) -> Array:
    """(T,) time of a case in percent of the longest tick of the case `of`, as in Figure 7."""
    share: Array = 100.0 * runs[name].seconds / runs[of].seconds.max()
    return share


def _no_clock() -> float:
    return 0.0


class _Outcome(NamedTuple):
    c: Array
    solved: bool
    steps: int
    active: BoolArray


def _newton(
    problem: GraspForceProblem, c: Array, active: BoolArray, clock: Callable[[], float]
) -> tuple[float, _Outcome]:
    """`tracked_selected` with Newton's method, in the same way."""
    blocks = find_blocks(problem)
    layout, packed = pack(problem, blocks)
    size, joints = problem.size, len(blocks.joints)
    place = np.searchsorted(problem.limited, blocks.joints)
    at = slice(2 + size + 2 * joints, 2 + size + 4 * joints)
    weight = packed[at].copy()
    own, shared = (np.empty(entries.shape) for entries in pattern(problem, blocks))
    out = np.empty(size + problem.contacts + 2 * problem.joints + 5)
    seconds, steps = 0.0, 0
    while True:
        packed[at] = weight * active.reshape(2, -1)[:, place].ravel()
        begin = clock()
        code, used = answer(
            layout, packed, problem.G, problem.J, own, shared, problem.tau_e, problem.h_e, c,
            OPTIMUM, out,
        )  # fmt: skip
        seconds, steps = seconds + clock() - begin, steps + used
        found = out[:size].copy()
        tau = cost.torques(problem, found)[problem.limited]
        low, high = problem.tau_min[problem.limited], problem.tau_max[problem.limited]
        broken = ~active & ~(np.concatenate([tau - low, high - tau]) > 0.0)
        if code != _SOLVED or not broken.any():
            return seconds, _Outcome(found, code == _SOLVED, steps, active)
        active = active | broken


def _newton_split(
    problem: GraspForceProblem, ticks: tuple[Fixed, Tick, Tick], hands: IntArray, c: Array,
    weighted: bool, clock: Callable[[], float],
) -> tuple[float, _Outcome]:  # fmt: skip
    """`tracked_split` with Newton's method for each hand; no joint may move two hands."""
    active = np.ones(2 * len(problem.limited), dtype=np.bool_)
    begin = clock()
    common, _ = common_point(*ticks, hands, c, METHODS["flow18"], weighted, MOST)
    seconds, steps = clock() - begin, common.steps
    if common.code != DONE:
        return seconds, _Outcome(c, False, steps, active)
    found = problem.scale * common.u
    start = found.copy()
    for h in range(int(hands.max()) + 1):
        own, contacts = hands == h, hands[problem.first] == h
        joints = (problem.J[own] != 0.0).any(axis=0)
        alone = replace(
            problem, G=problem.G[:, own], J=problem.J[own][:, joints], mu=problem.mu[contacts],
            h_e=problem.G[:, own] @ start[own], tau_e=problem.tau_e[joints],
            tau_min=problem.tau_min[joints], tau_max=problem.tau_max[joints],
            mu_t=np.asarray(problem.mu_t)[contacts],
            model=[m for m, mine in zip(problem.model, contacts, strict=True) if mine],
        )  # fmt: skip
        every = np.ones(2 * len(alone.limited), dtype=np.bool_)
        more, outcome = _newton(alone, start[own], every, clock)
        seconds, steps = seconds + more, steps + outcome.steps
        if not outcome.solved:
            return seconds, _Outcome(c, False, steps, active)
        found[own] = outcome.c
    return seconds, _Outcome(found, True, steps, active)


@final
class _Course:
    """One case on its way: its last solved tick, and the rows so far."""

    def __init__(
        self, case: Case, problem: GraspForceProblem, start: Array, hands: IntArray
    ) -> None:
        self.case, self.hands = case, by_component(problem, hands)
        self.previous = self._own(problem)
        self.c = np.array(start, dtype=np.float64)
        self.active: BoolArray | None = None
        self.rows: list[tuple[object, ...]] = []

    def _own(self, problem: GraspForceProblem) -> GraspForceProblem:
        if self.case.limits:
            return problem
        free = np.full(problem.joints, np.inf)
        return problem.with_(tau_min=-free, tau_max=free)

    def step(
        self, problem: GraspForceProblem, tolerance: float, most: int, clock: Callable[[], float],
        repeats: int,
    ) -> None:  # fmt: skip
        """One tick."""
        own = self._own(problem)
        share = self._share(problem)
        seconds, outcome = self._solved(own, tolerance, most, clock)
        for _ in range(repeats - 1):
            seconds = min(seconds, self._solved(own, tolerance, most, clock)[0])
        if outcome.solved:
            self.c, self.previous, self.active = outcome.c, own, outcome.active
        count = len(share)
        loads = np.array(
            [problem.G[:, self.hands == h] @ self.c[self.hands == h] for h in range(count)]
        )
        self.rows.append((
            self.c, cost.torques(problem, self.c), cost.cone_margins(problem, self.c),
            cost.torque_margins(problem, self.c), cost.cost(own, self.c), seconds, outcome.steps,
            int(outcome.active.sum()), outcome.solved, share,
            np.linalg.norm(loads[:, :3], axis=1), np.linalg.norm(loads[:, 3:], axis=1),
        ))  # fmt: skip

    def _share(self, problem: GraspForceProblem) -> Array:
        """(H,) by the forces that the tick begins with."""
        fix = fixed(problem)
        rows = assemble(fix, tick(self.previous))
        slack = rows.b @ (self.c / fix.scale) + rows.free
        delta = rooms(rows.b, np.maximum(slack, 0.0), self.hands)
        share: Array = delta / delta.sum()
        return share

    def _solved(
        self, problem: GraspForceProblem, tolerance: float, most: int, clock: Callable[[], float]
    ) -> tuple[float, _Outcome]:
        case, c = self.case, self.c
        active = np.ones(2 * len(problem.limited), dtype=np.bool_)
        if case.sigma is not None and not case.split:
            active = active_after(self.previous, c, case.sigma, self.active)
        if case.method == "newton" and not case.split:
            return _newton(problem, c, active, clock)
        fix, before, now = fixed(problem), tick(self.previous), tick(problem)
        if case.method == "newton":
            return _newton_split(problem, (fix, before, now), self.hands, c, case.weighted, clock)
        method, begin = METHODS[case.method], clock()
        if case.split:
            found, _ = tracked_split(
                fix, before, now, self.hands, c, method, case.weighted, tolerance, most
            )
        else:
            found, active, _ = tracked_selected(
                fix, before, now, active, c, method, tolerance, most
            )
        seconds = clock() - begin
        return seconds, _Outcome(fix.scale * found.u, found.code == DONE, found.steps, active)

    def result(self) -> CaseRun:
        """The rows as arrays."""
        return CaseRun(*(np.array(column) for column in zip(*self.rows, strict=True)))

"""How the time of a grasp-force solution grows with the number of contacts.

Contacts spread over a sphere, three joints each, J in its block form; the wrench turns by a little
from step to step. All sizes are timed in turn in every round; the exponent is the slope of a line
through the medians over the rounds, both axes logarithmic. Called by benchmarks/forces.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from tests.forces.problems import many_contacts
from wbc.arrays import Array
from wbc.forces import POINT, SOFT_FINGER, GraspForceProblem, HandJacobian
from wbc.forces.blocks import pattern
from wbc.forces.solver import ForceSolver
from wbc.rotations import exp_so3

_SIZES = (10, 30, 100, 300, 1000)
_ASKED = {"warm": 1.1, "cold": 1.2}
_TURN = 2e-3  # of the wrench from step to step, [rad]


def turned(h_e: Array, k: int) -> Array:
    """The wrench of step k."""
    r = exp_so3(np.array([_TURN * k, 0.5 * _TURN * k, 0.0]))
    return np.concatenate([r @ h_e[:3], r @ h_e[3:]])


def per_step(function: Callable[[int], object], steps: int) -> float:
    """CPU seconds of one step."""
    start = time.process_time()
    for k in range(steps):
        function(k)
    return (time.process_time() - start) / steps


class Size:
    """A problem of n contacts, to be solved warm and cold."""

    def __init__(self, n: int, model: str) -> None:
        problem: GraspForceProblem = many_contacts(n, model)
        self.problem, self.solver = problem, ForceSolver(problem)
        own, shared = pattern(problem, self.solver.blocks)
        self.jacobian = HandJacobian(problem.J.ravel()[own], problem.J.ravel()[shared])
        self.steps = max(2, 1000 // n)
        self.last = self._solve(0, None)

    def _solve(self, k: int, start: Array | None) -> Array:
        p = self.problem
        step = self.solver.solve(p.G, self.jacobian, p.tau_e, turned(p.h_e, k), start)
        assert step.status.usable, step.status
        return step.c

    def warm(self) -> float:
        """Seconds a step, each from the one before."""
        self.last = self._solve(0, None)

        def step(k: int) -> None:
            self.last = self._solve(k + 1, self.last)

        return per_step(step, self.steps)

    def cold(self) -> float:
        """Seconds a step with nothing to begin from: phase I included."""
        return per_step(lambda k: self._solve(k, None), max(1, self.steps // 10))


def figures(quick: bool) -> list[tuple[str, str, str, bool]]:
    """Claim, figure, what is asked and whether it holds, warm and cold, of both contact models."""
    rows = []
    for model in (POINT,) if quick else (POINT, SOFT_FINGER):
        sizes = [Size(n, model) for n in _SIZES]
        rounds = [
            [(size.warm(), size.cold()) for size in sizes] for _ in range(3 if quick else 9)
        ]  # fmt: skip
        middle = np.median(np.array(rounds), axis=0)  # (sizes, 2)
        for (name, most), seconds in zip(_ASKED.items(), middle.T, strict=True):
            slope = float(np.polyfit(np.log(_SIZES), np.log(seconds), 1)[0])
            took = ", ".join(f"{1e6 * s:.0f}" for s in seconds)
            rows.append((
                f"{model}: growth, {name}, n = {_SIZES[0]} ... {_SIZES[-1]} ({took} us)",
                f"n^{slope:.2f}", f"<= {most:g}", slope <= most,
            ))  # fmt: skip
    return rows

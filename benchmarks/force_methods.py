"""The chapter's claims on selection and split, with its flows and with Newton's method.

    python -m benchmarks.force_methods [--every N]

The pouring case without a robot (tests/forces/problems.py), 1000 ticks of 2 ms, for point contacts
at the load of the chapter and at 1.4 times that, and for soft fingers. Every tick is solved by each
variant in turn in this process; a time is CPU time of one compiled call, the second of two, a ratio
that to all torque bounds at the same tick, and what is printed its median, so that the machine's
speed cancels. The choice of the bounds itself and the evaluation of the result are not timed.

What counts as reproduced: selection by at least 30 % at σ_τ = 0 and 80 to 90 % at 0.8, the split by
30 to 50 %. The floor is a call that does nothing, which no method can save.
"""

from __future__ import annotations

import argparse
import gc
import platform
import time
from dataclasses import replace

import numpy as np

import wbc.compiled
from tests.forces.problems import pouring
from wbc.arrays import Array
from wbc.compiled import kernel
from wbc.forces import POINT, SOFT_FINGER, solve
from wbc.forces.flow_kernels import Fixed, Tick, fixed, tick
from wbc.forces.study import ALL, CASES, CaseRun, run

_METHODS = ("flow18", "flow20", "newton")
_CLAIMS = {"sigma 0": "- 30 %", "sigma 0.8": "- 90 %", "split weighted": "up to - 50 %"}
_PROBLEMS = ((POINT, 1.0), (POINT, 1.4), (SOFT_FINGER, 1.0))
_TOLERANCE = 1e-5
_HANDS = np.repeat([0, 1], 5)


@kernel
def _nothing(fix: Fixed, before: Tick, now: Tick, c: Array) -> float:
    return c[0]


def floor(model: str) -> float:
    """Seconds of a call with the arguments of a tick, and nothing done."""
    problem = next(iter(pouring(model)))
    given = fixed(problem), tick(problem), tick(problem), np.zeros(problem.size)
    _nothing(*given)
    times = []
    for _ in range(2000):
        begin = time.thread_time()
        _nothing(*given)
        times.append(time.thread_time() - begin)
    return float(np.median(times))


def table(model: str, load: float, every: int) -> None:
    """One row a variant of each method."""
    ticks = list(pouring(model, load=load))[::every]
    cases = [
        replace(case, name=f"{method} {case.name}", method=method)
        for method in _METHODS
        for case in CASES
    ]
    start = solve(ticks[0]).c
    run(ticks[:2], start, _HANDS, cases=cases)  # compiles
    gc.disable()
    runs = run(
        ticks, start, _HANDS, cases=cases, tolerance=_TOLERANCE, clock=time.thread_time, repeats=2
    )
    gc.enable()
    print(f"\n## {model}, load {load}: {len(ticks)} ticks of {2 * every} ms")
    print(f"A call that does nothing: {1e6 * floor(model):.0f} us.\n")
    print("| method | bounds | time | chapter | us | x Newton | steps | active | Φ | least room |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for method in _METHODS:
        for case in CASES:
            _row(runs, method, case.name)


def _row(runs: dict[str, CaseRun], method: str, name: str) -> None:
    mine, whole = runs[f"{method} {name}"], runs[f"{method} {ALL.name}"]
    newton = runs[f"newton {ALL.name}"]
    ok = mine.solved & whole.solved & newton.solved
    change = 100.0 * (float(np.median((mine.seconds / whole.seconds)[ok])) - 1.0)
    times = float(np.median((mine.seconds / newton.seconds)[ok]))
    with np.errstate(invalid="ignore"):
        phi = float(np.median((mine.phi / newton.phi)[ok]))
    lost = "" if mine.solved.all() else f" ({100.0 * (1.0 - mine.solved.mean()):.1f} % not solved)"
    print(
        f"| {method} | {name} | {change:+.0f} %{lost} | {_CLAIMS.get(name, '')} "
        f"| {1e6 * np.median(mine.seconds):.0f} | {times:.1f} | {mine.steps.mean():.1f} "
        f"| {mine.active.mean():.1f} | {phi:.4f} | {1e3 * mine.torque_margin.min():.2f} mNm |"
    )


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--every", type=int, default=1, help="only each N-th tick")
    args = parser.parse_args()
    print(
        f"# numpy {np.__version__}, python {platform.python_version()}, "
        f"{'compiled' if wbc.compiled.COMPILED else 'NOT compiled'}"
    )
    for model, load in _PROBLEMS:
        table(model, load, args.every)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Exchanges in space with the object elsewhere: which complete, which are refused, and why.

    python benchmarks/variations.py [--quick] [--coarse] [--count N] [SCENARIO ...]

What varies, and what must come of it, is in tests/exchange/variations.py. Two run at a time. Exit
code 1 if one neither completes inside all limits nor is refused before motion.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from exchange import variations

QUICK = 2
PROCESSES = 2


def main() -> int:
    """Print a row for each, then the worst of those that completed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=variations.SCENARIOS, metavar="SCENARIO")
    parser.add_argument("--count", type=int, default=variations.COUNT)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} of each scenario")
    parser.add_argument("--coarse", action="store_true", help="ticks of 4 ms, half the time")
    arguments = parser.parse_args()
    count = QUICK if arguments.quick else arguments.count
    judge = variations.judge_coarse if arguments.coarse else variations.judge
    failed = 0
    with ProcessPoolExecutor(PROCESSES) as processes:
        for scenario in arguments.scenarios:
            results = []
            judged = processes.map(judge, repeat(scenario, count), range(count))
            for number, result in enumerate(judged):
                results.append(result)
                print(f"{scenario} {number:2d}: {_row(result)}", flush=True)
            failed += sum(result.verdict == "FAILED" for result in results)
            print(_summary(scenario, results), flush=True)
    return 1 if failed else 0


def _row(result: variations.Result) -> str:
    reached = ", ".join(f"{name} {value:.3g}" for name, value in result.figures.items())
    return " | ".join((result.verdict, *result.reasons, *([reached] if reached else [])))


def _summary(scenario: str, results: list[variations.Result]) -> str:
    counts = Counter(result.verdict for result in results)
    said = ", ".join(f"{n} {verdict}" for verdict, n in sorted(counts.items()))
    ran = [result.figures for result in results if result.figures]
    worst = [
        f"{name} {(min if name in variations.ROOMS else max)(f[name] for f in ran):.3g}"
        for name in (ran[0] if ran else ())
    ]
    return f"{scenario}: {said} of {len(results)}; worst: {', '.join(worst) or 'none ran'}"


if __name__ == "__main__":
    raise SystemExit(main())

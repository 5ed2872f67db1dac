"""Objects on which the exchange cannot be done: how the run ends, and that it ends honestly.

    python benchmarks/negative_cases.py

The shapes are in tests/exchange/negative.py. Exit code 1 if one of them claims success, violates a
limit, lets links meet or loses the object.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from exchange import negative


def main() -> int:
    """Run every shape and print what its summary says."""
    wrong = 0
    for shape in negative.SHAPES:
        result = negative.run(shape)
        summary, faults = negative.summary(result), negative.faults(result)
        wrong += bool(faults)
        reached = ", ".join(f"{name} {x:.3g}" for name, x in negative.figures(result).items())
        print(f"{shape}: success {summary['success']}; {summary['reason']} ({reached})", flush=True)
        for fault in faults:
            print(f"  not as it should be: {fault}")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Objects on which the exchange cannot be done: how the run ends, and that it ends honestly.

    python benchmarks/negative_cases.py

The shapes are in tests/exchange/negative.py. Exit code 1 if one of them claims success.
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
        summary = negative.summary(negative.run(shape))
        wrong += bool(summary["success"])
        print(f"{shape}: success {summary['success']}; {summary['reason']}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())

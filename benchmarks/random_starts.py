"""Sixteen random starts of the exchange: where they end, how well, and whether all converge.

    python benchmarks/random_starts.py [COUNT]

What varies, and what converging means, is in tests/exchange/starts.py. Exit code 1 if one fails.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from exchange import starts


def main() -> int:
    """Run them one after the other and print a row each."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else starts.COUNT
    failed = 0
    for number in range(count):
        result = starts.run(number)
        faults = starts.faults(result)
        failed += bool(faults)
        reached = ", ".join(f"{name} {value:.3g}" for name, value in starts.figures(result).items())
        print(f"{number:3d}: {'; '.join(faults) or 'converged'} ({reached})", flush=True)
    print(f"{count - failed} of {count} converge")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())

"""``python -m wbc``."""

from __future__ import annotations

import sys

from wbc.cli import main

if __name__ == "__main__":
    sys.exit(main())

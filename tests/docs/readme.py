"""The README, taken apart."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Contents of the fenced blocks of a language ('' for plain ones), in order."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    return [content for kind, content in found if kind == language]


def shell_lines() -> list[str]:
    """Every command of the shell blocks, and every `wbc ...` and `pip ...` in running text."""
    lines = [line for block in blocks("sh") for line in block.splitlines() if line]
    prose = re.sub(r"^```.*?^```$", "", TEXT, flags=re.MULTILINE | re.DOTALL)
    return lines + re.findall(r"`((?:wbc|pip) [a-z][^`]*)`", prose.replace("\n  ", " "))


def tick_rows() -> list[tuple[str, Path]]:
    """Call and file of the table of the tick, in order."""
    rows = re.findall(r"^\| \d+ \| `(\w+)` \| .* \| (\S+\.py) \|$", TEXT, re.MULTILINE)
    return [(call, ROOT / "wbc" / where) for call, where in rows]


def links() -> list[str]:
    """Targets of the links and pictures that stay in the repository."""
    return [link for link in re.findall(r"\]\(([^)#]+)\)", TEXT) if "://" not in link]

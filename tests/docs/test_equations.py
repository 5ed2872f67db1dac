"""Every equation has its function and its test, and both exist."""

from __future__ import annotations

import functools
import importlib
import re

import pytest

from .readme import ROOT

TEXT = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
    for line in TEXT.splitlines()
    if line.startswith("| ") and not line.startswith("| equation")
]
FUNCTIONS = sorted(set(re.findall(r"`(wbc[\w.]+:[\w.]+)`", TEXT)))
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py::\w+)`", TEXT)))


def test_every_equation_is_here() -> None:
    numbered = {int(n) for row in ROWS for n in re.findall(r"\((\d+)\)", row[0])}
    assert numbered == set(range(1, 57))


def test_every_row_has_a_function_and_a_test() -> None:
    for equation, _, functions, tests in ROWS:
        assert ":" in functions and "::" in tests, equation


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_exist(name: str) -> None:
    module, path = name.split(":")
    functools.reduce(getattr, path.split("."), importlib.import_module(module))


@pytest.mark.parametrize("name", TESTS)
def test_tests_exist(name: str) -> None:
    path, function = name.split("::")
    text = (ROOT / path).read_text(encoding="utf-8")
    assert re.search(rf"^def {function}\(", text, re.MULTILINE)


def test_equations_named_in_the_code_are_here() -> None:
    """(24) to (56) as the docstrings cite them."""
    named: set[int] = set()
    for path in (ROOT / "wbc").rglob("*.py"):
        named |= {int(n) for n in re.findall(r"\((\d\d)\)", path.read_text(encoding="utf-8"))}
    assert {n for n in named if 24 <= n <= 56} <= set(range(24, 57))

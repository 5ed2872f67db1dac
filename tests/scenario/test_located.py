"""YAML as YAML 1.2 means it, with places, and bounded."""

from __future__ import annotations

import time

import pytest

from wbc.scenario.located import MAX_BYTES, MAX_DEPTH, MAX_NODES, read_text, read_value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E5", 1e5),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("010", 10),
        ("0o10", 8),
        ("0x1F", 31),
        ("+12", 12),
        ("1_000", "1_000"),
        ("12:30:00", "12:30:00"),
        ("on", "on"),
        ("no", "no"),
        ("y", "y"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("null", None),
        ("2024-01-01", "2024-01-01"),
        ("0b11", "0b11"),
        ("=", "="),
        ("'1'", "1"),
        ("!!str 1", "1"),
        ("!!float 1", 1.0),
        (".inf", float("inf")),
        ("-.INF", float("-inf")),
        ("9" * 19, 1e19),
        ("9" * 5000, float("inf")),
        ("e5", "e5"),
        (".", "."),
        ("-", [None]),
    ],
)
def test_the_core_schema(text: str, value: object) -> None:
    located = read_value(text)
    assert not located.faults
    assert located.data == value
    assert type(located.data) is type(value)


def test_keys_and_values_know_their_place() -> None:
    located = read_text(b"# c\na: 1\nb:\n  - {c: x, d: [1,\n      2]}\n")
    assert located.data == {"a": 1, "b": [{"c": "x", "d": [1, 2]}]}
    assert located.keys[("a",)] == (2, 1)
    assert located.values[("a",)] == (2, 4)
    assert located.keys[("b", 0, "d")] == (4, 12)
    assert located.values[("b", 0, "d", 1)] == (5, 7)


def test_a_bom_and_windows_line_ends_change_nothing() -> None:
    located = read_text(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    assert located.data == {"a": 1, "b": 2}
    assert located.keys[("a",)] == (1, 1)
    assert located.keys[("b",)] == (2, 1)


def test_aliases_repeat_their_value() -> None:
    located = read_text(b"a: &x {k: 1}\nb: *x\n")
    assert located.data == {"a": {"k": 1}, "b": {"k": 1}}
    assert located.values[("b", "k")] == (1, 11)
    located.data["b"]["k"] = 2
    assert located.data["a"]["k"] == 1


TAB = "a tab stands here: indent with spaces"
COLON = "a ':' out of place: wrong indentation, or text that needs quotes"
PLAIN = "is not allowed: a scenario is plain data"


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("a:\n\tb: 1\n", (2, 1), TAB),
        ("a: b: c\n", (1, 5), COLON),
        ("a: {b: 1,\nc: 2", (2, 5), "the '{' opened at 1:4 is not closed before this"),
        ("a: [1, 2\nb: 3\n", (2, 2), "the '[' opened at 1:4 is not closed before this"),
        ("a: 'x\nb: 1\n", (1, 4), "the quote opened here is never closed"),
        ("a:\n  b: 1\n c: 2\n", (3, 2), "the indentation does not match the lines above"),
        ("a: - 1\n", (1, 4), "a list item cannot start here: put it on a new line"),
        ("a: %x\n", (1, 4), "a value cannot start with '%': put it in quotes"),
        ('a: "\\q"\n', (1, 6), "an unknown escape: use single quotes for plain text"),
        ('a: "\\U0FFFFFFF"\n', (1, 7), "an escape names no character"),
        ("a: *x\n", (1, 4), "the alias '*x' has no anchor '&x' before it"),
        ("a: &x 1\nb: &x 2\n", (2, 4), "the anchor '&x' is already taken"),
        ("a: 1\n---\nb: 2\n", (2, 1), "a second document starts here: a scenario is one document"),
        ("a: 1\n...\nfoo\n", (3, 1), "unexpected text after the end of the data"),
        ("", (1, 1), "the file is empty"),
        ("# only a comment\n", (1, 1), "the file is empty"),
        ("a: 1\nb: \x07\n", (2, 4), "the character U+0007 is not allowed"),
        ("a\nb: 1", (2, 2), COLON),
        ("a: &x [*x]\n", (1, 4), f"too deeply nested: a scenario has at most {MAX_DEPTH} levels"),
        ("a: !!python/object:x y\n", (1, 4), f"the tag '!!python/object:x' {PLAIN}"),
        ("a: !!python/object/apply:os.system [ls]\n", (1, 4),
         f"the tag '!!python/object/apply:os.system' {PLAIN}"),
        ("a: !!binary aGk=\n", (1, 4), f"the tag '!!binary' {PLAIN}"),
        ("a: !mine {b: 1}\n", (1, 4), f"the tag '!mine' {PLAIN}"),
        ("a: !<x y\n", (1, 7), "an unknown tag: a scenario is plain data"),
        ("a: !x!y z\n", (1, 4), "an unknown tag: a scenario is plain data"),
        ("a: &\n", (1, 5), "an '&' or '*' without a name: text that begins with it needs quotes"),
        ("a: [1, , 2]\n", (1, 8), "a value is missing here"),
        ("a: ? b\n", (1, 4), "a '?' out of place: text that begins with it needs quotes"),
        ("a: |x\n", (1, 5), "after '|' or '>' the text starts on the next line"),
        ("%YAML 3.0\n---\na: 1\n", (1, 1), "a line that begins with '%' is not understood: "
         "remove it"),
        ("a: 'x\n---\n", (1, 4), "the quote opened here is never closed"),
        ("a: !!int x\n", (1, 4), "'x' is no int"),
        ("a: 1\nb: 2\na: 3\n", (3, 1), "duplicate key 'a' (first on line 1)"),
        ("a: {b: 1, b: 2}\n", (1, 11), "duplicate key 'b' (first on line 1)"),
        ("1: x\n", (1, 1), "a key must be text: write '1'"),
        ("? [a]\n: x\n", (1, 3), "a key must be text"),
        ("~: x\n", (1, 1), "a key must be text: write '~'"),
        ('a: "\\ud800"\n', (1, 4), "this text holds half a character (a lone surrogate)"),
    ],
)  # fmt: skip
def test_what_is_refused(text: str, place: tuple[int, int], words: str) -> None:
    (fault,) = read_text(text.encode()).faults
    assert fault.text == words
    assert fault.mark == place


def test_bytes_that_are_no_text() -> None:
    (fault,) = read_text(b"a: 1\nb: \xff\xfe\n").faults
    assert fault.text == "not UTF-8 text (byte 0xff)"
    assert fault.mark == (2, 4)


def test_several_faults_are_found_in_one_reading() -> None:
    located = read_text(b"a: !x 1\nb: 2\nb: 3\n4: 5\n")
    assert [fault.mark for fault in located.faults] == [(1, 4), (3, 1), (4, 1)]
    assert located.data == {"a": None, "b": 2}
    assert located.unread == {("a",)}


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{after}: &{after} [{', '.join(['*' + before] * 9)}]\n"
    for before, after in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    "text",
    [
        BOMB,
        "[" * 100_000,
        "{a: " * 40_000,
        "- " * 90_000,
        "a:\n" + "".join(" " * i + "- \n" for i in range(1, 300)),
        "[" + "1," * 60_000 + "]",
        "a: " + "9" * 150_000,
        "? " * 90_000,
        "a: '" + "x" * 190_000,
        "#" + "x" * 190_000,
        "a: 1 " + " " * 190_000 + "b",
        "&a " * 60_000,
        "x" * (MAX_BYTES + 1),
    ],
    ids=lambda text: text[:6],
)
def test_hostile_texts_are_judged_quickly(text: str) -> None:
    start = time.perf_counter()
    located = read_text(text.encode())
    assert time.perf_counter() - start < 1.0
    assert all(fault.text.isprintable() for fault in located.faults)


def test_the_limits_say_what_they_are() -> None:
    assert "too large" in read_text(BOMB.encode()).faults[0].text
    assert f"at most {MAX_NODES} values" in read_text(BOMB.encode()).faults[0].text
    assert f"at most {MAX_BYTES}" in read_text(b"x" * (MAX_BYTES + 1)).faults[0].text

"""Two hundred damaged files: each loads or is refused in plain lines, quickly."""

from __future__ import annotations

import random
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from wbc import resources
from wbc.errors import ScenarioError
from wbc.scenario import load

JARGON = re.compile(
    r"pydantic|Traceback|Input should|validation error|type=|\bdict\b|NoneType|while scanning"
    r"|while parsing|<block|<scalar|cannot be read",
    re.IGNORECASE,
)
LINE = re.compile(r"t\.yaml:(\d+:\d+: |.*more faults$).*")
VALUES = ["true", "~", "[]", "{}", "-1", "0", "1e999", ".nan", "-.inf", "on", "'", '"', "[", "}",
          "9" * 300, "&a [*a]", "*b", "!!python/object:os.system x", "5 mm", "3 deg", "\t", "é",
          "- x", "{a: {b: {c: 1}}}", "'\\0'", "1 s: 2", "circle", "f1", "? x", "|", ">", "%x", "@x",
          "!", "&", "*", ","]  # fmt: skip


def delete(lines: list[str], rng: random.Random) -> None:
    del lines[rng.randrange(len(lines))]


def duplicate(lines: list[str], rng: random.Random) -> None:
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))


def rename(lines: list[str], rng: random.Random) -> None:
    i = rng.randrange(len(lines))
    words = list(re.finditer(r"\w+", lines[i]))
    if words:
        word = rng.choice(words)
        letters = list(word[0])
        rng.shuffle(letters)
        lines[i] = lines[i][: word.start()] + "".join(letters) + lines[i][word.end() :]


def retype(lines: list[str], rng: random.Random) -> None:
    i = rng.randrange(len(lines))
    value = rng.choice(VALUES)
    pieces = list(re.finditer(r"(?<=: )[^,{}\[\]#]+", lines[i]))
    if pieces:
        piece = rng.choice(pieces)
        lines[i] = lines[i][: piece.start()] + value + lines[i][piece.end() :]
    else:
        lines[i] += value


def indent(lines: list[str], rng: random.Random) -> None:
    i = rng.randrange(len(lines))
    lines[i] = rng.choice([" ", "   ", "\t"]) + lines[i]


def scribble(lines: list[str], rng: random.Random) -> None:
    i = rng.randrange(len(lines))
    at = rng.randrange(len(lines[i]) + 1)
    noise = "".join(chr(rng.choice([rng.randrange(1, 256), rng.randrange(0x2028, 0xD7FF)]))
                    for _ in range(3))  # fmt: skip
    lines[i] = lines[i][:at] + noise + lines[i][at:]


def nest(lines: list[str], rng: random.Random) -> None:
    depth = rng.choice([5, 30, 5000])
    lines.insert(rng.randrange(len(lines)), "deep: " + rng.choice(["[", "{a: "]) * depth)


def enlarge(lines: list[str], rng: random.Random) -> None:
    i = rng.randrange(len(lines))
    lines[i] = re.sub(r"\d+", lambda m: m[0] + "0" * rng.choice([3, 20, 400]), lines[i])


def truncate(lines: list[str], rng: random.Random) -> None:
    del lines[rng.randrange(1, len(lines)) :]
    lines[-1] = lines[-1][: rng.randrange(len(lines[-1]) + 1)]


MUTATIONS: list[Callable[[list[str], random.Random], None]] = [
    delete, duplicate, rename, retype, indent, scribble, nest, enlarge, truncate,
]  # fmt: skip


def damaged(seed: int) -> bytes:
    rng = random.Random(seed)
    text = resources.find("tasks", "planar_exchange").read_text(encoding="utf-8")
    lines = text.splitlines()
    for mutate in rng.choices(MUTATIONS, k=rng.choice([1, 1, 2, 4])):
        if len(lines) > 2:
            mutate(lines, rng)
    raw = "\n".join(lines).encode()
    if rng.random() < 0.1:
        at = rng.randrange(len(raw))
        raw = raw[:at] + rng.randbytes(4) + raw[at:]
    return raw


@pytest.mark.parametrize("seed", range(200))
def test_a_damaged_file_loads_or_is_refused_in_plain_lines(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.yaml").write_bytes(damaged(seed))
    start = time.perf_counter()
    try:
        load("t.yaml")
    except ScenarioError as error:
        lines = str(error).split("\n")
        assert error.__cause__ is None
        assert lines == list(dict.fromkeys(lines))
        for line in lines:
            assert LINE.fullmatch(line), line
            assert line.isprintable() and len(line) < 400, line
            assert not JARGON.search(line), line
    assert time.perf_counter() - start < 1.0


def test_the_damage_is_of_many_kinds(tmp_path: Path) -> None:
    # A fuzz that breaks every file in the same way, or none, would prove little.
    path, words, whole = tmp_path / "t.yaml", set(), 0
    for seed in range(200):
        path.write_bytes(damaged(seed))
        try:
            load(path)
            whole += 1
        except ScenarioError as error:
            first = str(error).split("\n")[0].split(": ", 1)[1]
            words.add(re.sub(r"'[^']*'|\d+", "", first))
    assert len(words) > 30
    assert 5 < whole < 100

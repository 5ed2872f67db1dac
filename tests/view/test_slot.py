"""The slot: whole snapshots only, whatever the writer does meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wbc.view.scene import Snapshot
from wbc.view.slot import (
    RING,
    TEXT_BYTES,
    Layout,
    SlotReader,
    SlotWriter,
    _Record,
    anonymous_file,
    leave_words,
)

from .demo import demo_scene, demo_snapshot

LAYOUT = Layout(bodies=20, contacts=4, tasks=6)


def uniform(k: int, layout: Layout = LAYOUT) -> Snapshot:
    """A snapshot whose every entry says the same number, so that a mixture shows."""
    c, m, flag = layout.contacts, layout.tasks, bool(k % 2)
    return Snapshot(
        t=float(k),
        bodies=np.full((layout.bodies, 7) if k % 3 else (layout.bodies, 4, 4), float(k)),
        object_pose=np.full(7, float(k)),
        contact_points=np.full((c, 3), float(k)),
        contact_normals=np.full((c, 3), float(k)),
        contact_mode=np.full(c, k % 3),
        in_stack=np.full(m, flag),
        activation=np.full(m, float(k)),
        phase=k,
        eps_f=float(k),
        eps_m=float(k),
        error=(float(k), float(k)),
        distance=float(k),
        status=str(k),
        text=str(k),
    )


def is_whole(s: Snapshot) -> bool:
    k = s.t
    numbers = (s.bodies, s.object_pose, s.contact_points, s.contact_normals, s.activation)
    flags = (s.in_stack,)
    return (
        all(bool((a == k).all()) for a in numbers)
        and all(bool((f == bool(k % 2)).all()) for f in flags)
        and (s.phase, s.eps_f, s.eps_m, s.text) == (int(k), k, k, str(int(k)))
        and (*s.error, s.distance, s.status) == (k, k, k, str(int(k)))
        and bool((s.contact_mode == k % 3).all())
        and s.bodies.ndim == (2 if k % 3 else 3)
    )


@pytest.fixture
def slot():
    fd = anonymous_file(LAYOUT.total_bytes)
    yield fd, SlotWriter(fd, LAYOUT), SlotReader(fd, LAYOUT)
    os.close(fd)


@pytest.mark.parametrize("matrices", [False, True])
def test_a_snapshot_comes_back_as_it_was(matrices):
    layout = Layout.of(demo_scene())
    fd = anonymous_file(layout.total_bytes)
    writer, reader = SlotWriter(fd, layout), SlotReader(fd, layout)
    os.close(fd)
    sent = demo_snapshot(0.7, matrices)
    writer.write(sent)
    got = reader.read()
    assert got is not None
    for name in Snapshot.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))


def test_nothing_before_the_first_and_nothing_twice(slot):
    _, writer, reader = slot
    assert reader.read() is None
    for k in range(1, 3 * RING):
        writer.write(uniform(k))
        assert reader.read().t == k
        assert reader.read() is None
    assert writer.drawn == writer.written == 3 * RING - 1


def test_the_latest_wins(slot):
    _, writer, reader = slot
    for k in range(1, 100):
        writer.write(uniform(k))
    assert reader.read().t == 99


def test_a_write_broken_off_is_never_seen(slot):
    """A snapshot of the wrong shape stops in the middle of its record."""
    _, writer, reader = slot
    writer.write(uniform(1))
    bad = uniform(2, Layout(bodies=20, contacts=4, tasks=3))
    for _ in range(2 * RING):
        with pytest.raises(ValueError):
            writer.write(bad)
    writer.write(uniform(3))
    assert is_whole(reader.read())
    assert reader.read() is None


def test_a_damaged_record_is_refused(slot):
    """Stands for stores that become visible in another order than they were made."""
    _, writer, reader = slot
    writer.write(uniform(5))
    memory = reader._memory.record_bytes(LAYOUT, 1)
    memory[1000] ^= 1
    assert reader.read() is None
    memory[1000] ^= 1
    assert is_whole(reader.read())


def test_text_is_cut_between_characters(slot):
    _, writer, reader = slot
    snapshot = uniform(1)
    object.__setattr__(snapshot, "text", "ε" * TEXT_BYTES)
    writer.write(snapshot)
    assert reader.read().text == "ε" * (TEXT_BYTES // 2)


def test_last_words(slot):
    fd, writer, _ = slot
    assert writer.last_words == ""
    leave_words(fd, "no ε")
    assert writer.last_words == "no ε"


HAMMER = """
import itertools, sys
sys.path[:0] = sys.argv[3:]
from wbc.view import slot
slot.RING = int(sys.argv[2])
from view.test_slot import LAYOUT, uniform
ready = [uniform(k) for k in range(1, 400)]
writer = slot.SlotWriter(int(sys.argv[1]), LAYOUT)
for snapshot in itertools.cycle(ready):
    writer.write(snapshot)
"""


def hammered(fd: int, ring: int) -> subprocess.Popen[bytes]:
    """A process that writes without pause; it is killed in the middle of a write, most likely."""
    tests = Path(__file__).resolve().parents[1]
    command = [sys.executable, "-c", HAMMER, str(fd), str(ring), str(tests), str(tests.parent)]
    return subprocess.Popen(command, pass_fds=(fd,))


def test_no_torn_read_under_a_writer_without_pause(slot):
    """The ring also lets the reader get through nearly every time."""
    fd, writer, reader = slot
    process = hammered(fd, RING)
    try:
        reads, last, until = 0, 0, time.monotonic() + 60.0
        while time.monotonic() < until and reads < 3000:
            snapshot = reader.read()
            if snapshot is None:
                continue
            reads += 1
            assert is_whole(snapshot), f"torn at read {reads}"
            assert reader._last > last
            last = reader._last
        assert reads == 3000, "the reader starved"
        assert writer.written > reads
    finally:
        process.kill()
        process.wait()
    final = reader.read()
    assert final is None or is_whole(final)


def test_the_checks_catch_reads_that_are_torn(monkeypatch):
    """With a ring of one nearly every read is overtaken: here the checks have all the work."""
    monkeypatch.setattr("wbc.view.slot.RING", 1)
    fd = anonymous_file(LAYOUT.total_bytes)
    reader = SlotReader(fd, LAYOUT)
    process = hammered(fd, 1)
    try:
        torn, good, until = 0, 0, time.monotonic() + 60.0
        while (torn < 50 or good < 10) and time.monotonic() < until:
            snapshot = reader.read()
            good += snapshot is not None
            assert snapshot is None or is_whole(snapshot)
            raw = _Record(reader._memory.record_bytes(LAYOUT, 0).copy(), LAYOUT)
            torn += not bool((raw.activation == raw.scalars[0]).all())
        assert torn >= 50, "this test has no teeth: nothing was torn"
        assert good >= 10, "nothing came through"
    finally:
        process.kill()
        process.wait()
        os.close(fd)

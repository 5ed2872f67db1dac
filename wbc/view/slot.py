"""A slot that holds the latest snapshot, shared between the controller and the viewer process.

The controller overwrites, the viewer reads when it likes; neither waits for the other, and either
may die at any moment. The memory has no name in any file system, so nothing is left behind.

Torn reads: the writer goes round a ring of records and announces a record only when it is whole.
A record carries its number, negative while it is being written, and a checksum over number and
content. A reader that was overtaken sees a changed number; the checksum also covers processors
that let stores become visible in another order. A ring, rather than one record, keeps a writer
without pause from starving the reader.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.view.scene import ForceArrows, Scene, Snapshot

Bytes = NDArray[np.uint8]
RING = 8
TEXT_BYTES = 400
STATUS_BYTES = 240
_HEADER_BYTES = 512
_WORDS_BYTES = 400
_SCALARS = 8
_OF_OBJECT = 18  # numbers of `ForceArrows` that are not of a contact
_TEXT = 32  # where text, status and numbers of a record begin, in bytes
_STATUS = _TEXT + TEXT_BYTES
_VALUES = _STATUS + STATUS_BYTES


def anonymous_file(size: int) -> int:
    """A file descriptor of `size` zero bytes without a name; freed with its last user."""
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("wbc-view")
    else:  # macOS: a file already unlinked serves as well
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return fd


@dataclass(frozen=True)
class Layout:
    """How many bodies, contacts and tasks a record holds, and whether it holds forces."""

    bodies: int
    contacts: int
    tasks: int
    forces: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Layout:
        bodies, contacts = len(scene.body_names), len(scene.contact_names)
        return cls(bodies, contacts, len(scene.task_names), bool(scene.friction_angles))

    @property
    def doubles(self) -> int:
        forces = 7 * self.contacts + _OF_OBJECT if self.forces else 0
        return _SCALARS + 7 + 16 * self.bodies + 7 * self.contacts + 2 * self.tasks + forces

    @property
    def record_bytes(self) -> int:
        return _VALUES + 8 * self.doubles

    @property
    def total_bytes(self) -> int:
        return _HEADER_BYTES + RING * self.record_bytes


class _Record:
    """Named views into the bytes of one record."""

    def __init__(self, memory: Bytes, layout: Layout) -> None:
        self.mark = memory[:16].view(np.int64)  # number, checksum
        self.content = memory[16:].data
        lengths = memory[16:_TEXT].view(np.int64)
        self.text = lengths[:1], memory[_TEXT:_STATUS]
        self.status = lengths[1:], memory[_STATUS:_VALUES]
        values = memory[_VALUES:].view(np.float64)
        nb, nc, nt = layout.bodies, layout.contacts, layout.tasks
        cuts = np.cumsum((_SCALARS, 7, 3 * nc, 3 * nc, nc, nt, nt, 16 * nb))
        parts = np.split(values, cuts)
        self.scalars, self.object_pose = parts[0], parts[1]
        self.points, self.normals = parts[2].reshape(nc, 3), parts[3].reshape(nc, 3)
        self.contact_mode, self.in_stack, self.activation = parts[4], parts[5], parts[6]
        self.poses = parts[7][: 7 * nb].reshape(nb, 7)
        self.matrices = parts[7].reshape(nb, 4, 4)
        self.forces = None
        if layout.forces:
            cuts = np.cumsum((3 * nc, 3 * nc, nc, 3, 6, 6))
            plan, measured, *others = np.split(parts[8], cuts)
            self.forces = plan.reshape(nc, 3), measured.reshape(nc, 3), *others

    def fill(self, s: Snapshot) -> None:
        bodies = np.asarray(s.bodies)
        as_matrices = bodies.ndim == 3
        if as_matrices:
            self.matrices[...] = bodies
        else:
            self.poses[...] = bodies
        self.scalars[:] = (s.t, s.phase, s.eps_f, s.eps_m, *s.error, s.distance, as_matrices)
        self.object_pose[:] = s.object_pose
        self.points[...] = s.contact_points
        self.normals[...] = s.contact_normals
        self.contact_mode[:] = s.contact_mode
        self.in_stack[:] = s.in_stack
        self.activation[:] = s.activation
        for k, place in enumerate(self.forces or ()):
            place[...] = np.nan if s.forces is None else s.forces[k]
        _write_text(self.text, s.text)
        _write_text(self.status, s.status)

    def checksum(self, number: int) -> int:
        return zlib.crc32(self.content, number & 0xFFFFFFFF)

    def _arrows(self) -> ForceArrows | None:
        if self.forces is None or np.isnan(self.forces[2]).any():
            return None
        plan, measured, limited, *of_object = self.forces
        return ForceArrows(plan, measured, limited != 0.0, *of_object)

    def snapshot(self) -> Snapshot:
        t, phase, eps_f, eps_m, error_p, error_r, distance, as_matrices = self.scalars.tolist()
        return Snapshot(
            t=t,
            bodies=self.matrices if as_matrices else self.poses,
            object_pose=self.object_pose,
            contact_points=self.points,
            contact_normals=self.normals,
            contact_mode=self.contact_mode.astype(np.int64),
            in_stack=self.in_stack != 0.0,
            activation=self.activation,
            phase=int(phase),
            eps_f=eps_f,
            eps_m=eps_m,
            error=(error_p, error_r),
            distance=distance,
            status=_read_text(self.status),
            text=_read_text(self.text),
            forces=self._arrows(),
        )


def _write_text(place: tuple[NDArray[np.int64], Bytes], text: str) -> None:
    """As much of `text` as there is room for; the length first."""
    length, room = place
    raw = text.encode("utf-8", "replace")[: len(room)]
    length[0] = len(raw)
    if raw:
        room[: len(raw)] = np.frombuffer(raw, dtype=np.uint8)


def _read_text(place: tuple[NDArray[np.int64], Bytes]) -> str:
    length, room = place
    return room[: int(length[0])].tobytes().decode("utf-8", "ignore")


class _Memory:
    """The mapped bytes: a header written mostly by the reader, then the ring."""

    def __init__(self, fd: int, layout: Layout) -> None:
        # The arrays keep the map alive; it is unmapped when the last of them goes.
        self.bytes = np.frombuffer(mmap.mmap(fd, layout.total_bytes), dtype=np.uint8)
        self.head = self.bytes[:32].view(np.int64)  # latest, browsers, drawn, length of words
        self.words = self.bytes[64 : 64 + _WORDS_BYTES]

    def record_bytes(self, layout: Layout, i: int) -> Bytes:
        start = _HEADER_BYTES + i * layout.record_bytes
        return self.bytes[start : start + layout.record_bytes]


class SlotWriter:
    """The controller's end. One thread writes."""

    def __init__(self, fd: int, layout: Layout) -> None:
        self._memory = _Memory(fd, layout)
        self._records = [_Record(self._memory.record_bytes(layout, i), layout) for i in range(RING)]
        self._number = int(self._memory.head[0])

    def write(self, snapshot: Snapshot) -> None:
        """Make `snapshot` the latest. Takes a few microseconds and never waits.

        Raises:
            ValueError: an array does not have the shape the scene promised; nothing is published.
        """
        number = self._number = self._number + 1
        record = self._records[number % RING]
        record.mark[0] = -number
        record.fill(snapshot)
        record.mark[1] = record.checksum(number)
        record.mark[0] = number
        self._memory.head[0] = number

    @property
    def written(self) -> int:
        """Number of the latest snapshot; 0 before the first."""
        return int(self._memory.head[0])

    @property
    def drawn(self) -> int:
        """Number of the last snapshot the viewer took."""
        return int(self._memory.head[2])

    @property
    def browsers(self) -> int:
        """Pages connected, as last told by the viewer."""
        return int(self._memory.head[1])

    @property
    def last_words(self) -> str:
        """Why the viewer ended, if it could still say so."""
        length = min(int(self._memory.head[3]), _WORDS_BYTES)
        return self._memory.words[:length].tobytes().decode("utf-8", "ignore")


class SlotReader:
    """The viewer's end."""

    def __init__(self, fd: int, layout: Layout) -> None:
        self._layout = layout
        self._memory = _Memory(fd, layout)
        self._last = 0

    def read(self) -> Snapshot | None:
        """The latest snapshot, or None when there is none newer than the one read last."""
        for _ in range(RING):
            number = int(self._memory.head[0])
            if number == self._last:
                return None
            shared = self._memory.record_bytes(self._layout, number % RING)
            record = _Record(shared.copy(), self._layout)
            unchanged = int(shared[:8].view(np.int64)[0]) == number == int(record.mark[0])
            if unchanged and record.checksum(number) == int(record.mark[1]):
                self._last = number
                self._memory.head[2] = number
                return record.snapshot()
        return None

    def tell_browsers(self, count: int) -> None:
        self._memory.head[1] = count


def leave_words(fd: int, words: str) -> None:
    """Write why the viewer ends where the controller's side can find it."""
    raw = words.encode("utf-8", "replace")[:_WORDS_BYTES]
    with mmap.mmap(fd, _HEADER_BYTES) as memory:
        memory[64 : 64 + len(raw)] = raw
        memory[24:32] = len(raw).to_bytes(8, "little")

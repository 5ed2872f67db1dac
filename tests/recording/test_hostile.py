"""Files that are no log, or pretend to be one: one line each, no code run, no memory taken."""

from __future__ import annotations

import io
import json
import os
import pickle
import random
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.recording import Log

from .runs import META, recorded, with_forces

Arrays = dict[str, np.ndarray]


@pytest.fixture
def arrays(tmp_path: Path) -> Arrays:
    """The arrays of a good log."""
    recorded(20).save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as data:
        return {name: data[name] for name in data.files}


def refused(path: Path, what: str) -> None:
    """Loading fails in one line that names the file and says `what`."""
    with pytest.raises(WbcError) as caught:
        Log.load(path)
    text = str(caught.value)
    assert "\n" not in text and str(path) in text and what in text, text


class Evil:
    """Makes a folder when it is unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return os.mkdir, (str(self.trace),)


def with_meta(**changes: Any) -> np.ndarray:
    return np.array(json.dumps({**json.loads(META.to_json()), **changes}))


CHANGES: dict[str, tuple[dict[str, Any], str]] = {
    "no time": ({"t": None}, "it has no array 't'"),
    "time is NaN": ({"t": np.array([0.0, np.nan, *range(2, 20)])}, "'t' does not increase"),
    "time goes back": ({"t": np.arange(20.0)[::-1]}, "'t' does not increase"),
    "time stands": ({"t": np.zeros(20)}, "'t' does not increase"),
    "time is text": ({"t": np.array(["0"] * 20)}, "'t' is of type"),
    "time is a float32": ({"t": np.arange(20, dtype=np.float32)}, "'t' is of type float32"),
    "time is longer": ({"t": np.arange(21.0)}, "'q' has shape (20, 3), expected 21 for T"),
    "time is a scalar": ({"t": np.array(0.0)}, "'t' has 0 axes, expected 1"),
    "q is flat": ({"q": np.zeros(60)}, "'q' has 1 axes, expected 2"),
    "a joint too many": ({"v": np.zeros((20, 4))}, "'v' has shape (20, 4), expected 3 for n"),
    "pose of six": ({"object_pose": np.zeros((20, 6))}, "expected 7 for 7"),
    "names are numbers": ({"joint_names": np.zeros(3)}, "'joint_names' are not text"),
    "other names": ({"joint_names": np.array(["a", "b", "c"])}, "not those of its meta"),
    "phase 2 of 2": ({"phase": np.full(20, 2)}, "'phase' goes outside 0 to 1"),
    "phase -1": ({"phase": np.full(20, -1)}, "'phase' goes outside 0 to 1"),
    "bools are ints": ({"in_contact": np.zeros((20, 2), int)}, "'in_contact' is of type int64"),
    "no such joint": ({"limit_joint": np.full(20, 3)}, "'limit_joint' goes outside"),
    "complex": ({"cost": np.zeros(20, complex)}, "'cost' is of type complex128"),
    "structured": ({"cost": np.zeros(20, [("a", float)])}, "'cost' is of type"),
    "no format": ({"format": None}, "it has no array 'format'"),
    "format 4": ({"format": np.array(4)}, "its format is not 3"),
    "two formats": ({"format": np.array([1, 1])}, "its format is not 3"),
    "no forces": ({"phi": None}, "it has no array 'phi'"),
    "forces from nowhere": ({"phi": np.zeros(20)}, "expected 0 for F"),
    "complete is a number": ({"complete": np.array(1)}, "'complete' is not a single value"),
    "meta is not JSON": ({"meta": np.array("{")}, "'meta' is not JSON"),
    "meta is deep": ({"meta": np.array("[" * 200_000)}, "'meta' is not JSON"),
    "meta is a list": ({"meta": np.array("[]")}, "'meta' is not a JSON object"),
    "meta is empty": ({"meta": np.array("{}")}, "'meta' lacks 'scenario'"),
    "dt is text": ({"meta": with_meta(dt="fast")}, "bad 'dt'"),
    "dt is true": ({"meta": with_meta(dt=True)}, "bad 'dt'"),
    "dt is huge": ({"meta": with_meta(dt=10**400)}, "bad 'dt'"),
    "dt is zero": ({"meta": with_meta(dt=0)}, "dt must be positive"),
    "dt is NaN": ({"meta": with_meta(dt=float("nan"))}, "'meta' is not JSON"),
    "seed is a float": ({"meta": with_meta(seed=0.5)}, "bad 'seed'"),
    "versions are a list": ({"meta": with_meta(versions=[])}, "bad 'versions'"),
    "a version is a number": ({"meta": with_meta(versions={"a": 1})}, "bad 'versions'"),
    "names in one text": ({"meta": with_meta(joint_names="abc")}, "bad 'joint_names'"),
    "limits are text": ({"meta": with_meta(q_lower=["a"] * 3)}, "bad 'q_lower'"),
}


FORCE_CHANGES: dict[str, tuple[dict[str, Any], str]] = {
    "a finger too many": ({"cone_margin": np.zeros((20, 3))}, "expected 2 for N"),
    "no such status": ({"force_status": np.full(20, 8)}, "'force_status' goes outside 0 to 7"),
    "a tick too few": ({"sum_normal": np.zeros(19)}, "expected 20 for F"),
    "no models": (
        {"meta": with_meta(contact_models=[])}, "it has 20 ticks of forces, and 20 ticks"
    ),
    "a model too many": (
        {"meta": with_meta(contact_models=["point"] * 3)}, "contact_models has 3 entries"
    ),
    "friction is null": ({"meta": with_meta(mu=[None, 0.5])}, "bad 'mu'"),
}  # fmt: skip


@pytest.mark.parametrize("case", FORCE_CHANGES)
def test_planned_forces_that_are_wrong_are_named(tmp_path: Path, case: str) -> None:
    changes, what = FORCE_CHANGES[case]
    with_forces(20).save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as data:
        np.savez(tmp_path / "bad.npz", **{**data, **changes})
    refused(tmp_path / "bad.npz", what)


@pytest.mark.parametrize("case", CHANGES)
def test_an_array_that_is_wrong_is_named(tmp_path: Path, arrays: Arrays, case: str) -> None:
    changes, what = CHANGES[case]
    changed = {k: v for k, v in {**arrays, **changes}.items() if v is not None}
    np.savez(tmp_path / "bad.npz", **changed)
    refused(tmp_path / "bad.npz", what)


def test_an_array_stored_by_columns_is_read_right(tmp_path: Path, arrays: Arrays) -> None:
    np.savez(tmp_path / "columns.npz", **{**arrays, "q": np.asfortranarray(arrays["q"])})
    assert (Log.load(tmp_path / "columns.npz").q == arrays["q"]).all()


def test_pickles_are_not_opened(tmp_path: Path, arrays: Arrays) -> None:
    trace = tmp_path / "trace"
    evil = np.array([Evil(trace)], dtype=object)
    np.savez(tmp_path / "array.npz", **{**arrays, "cost": evil})
    refused(tmp_path / "array.npz", "'cost' holds Python objects")
    (tmp_path / "whole.npz").write_bytes(pickle.dumps(Evil(trace)))
    refused(tmp_path / "whole.npz", "is not a log of wbc")
    with zipfile.ZipFile(tmp_path / "member.npz", "w") as archive:
        for name in arrays:
            archive.writestr(f"{name}.npy", pickle.dumps(Evil(trace)))
    refused(tmp_path / "member.npz", "damaged header")
    np.savez(tmp_path / "extra.npz", **arrays, extra=evil)
    assert Log.load(tmp_path / "extra.npz").ticks == 20  # what is not asked for is not read
    assert not trace.exists()


def header(text: str) -> bytes:
    data = text.encode("latin1")
    return b"\x93NUMPY\x01\x00" + len(data).to_bytes(2, "little") + data


HEADERS = {
    "claims more than there is": "{'descr': '<f8', 'fortran_order': False, 'shape': (10**9,)}",
    "claims a terabyte": "{'descr': '<f8', 'fortran_order': False, 'shape': (137438953472,)}",
    "claims less than nothing": "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}",
    "claims nothing of everything": (
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 99999999999999999999)}"
    ),
    "is code": "__import__('os').abort()",
    "is deep": "(" * 5000,
    "has no type": "{'descr': 'zz', 'fortran_order': False, 'shape': (1,)}",
    "has items of no size": "{'descr': '|S0', 'fortran_order': False, 'shape': (1,)}",
    "is empty": "",
}


@pytest.mark.parametrize("case", HEADERS)
def test_headers_that_lie(tmp_path: Path, arrays: Arrays, case: str) -> None:
    np.savez(tmp_path / "bad.npz", **{k: v for k, v in arrays.items() if k != "t"})
    with zipfile.ZipFile(tmp_path / "bad.npz", "a") as archive:
        archive.writestr("t.npy", header(HEADERS[case]))
    refused(tmp_path / "bad.npz", "")


@pytest.mark.parametrize("data", [b"", b"\x93NUMPY", b"\x93NUMPY\x09\x00aaaa", b"PK"])
def test_arrays_that_are_none(tmp_path: Path, arrays: Arrays, data: bytes) -> None:
    np.savez(tmp_path / "bad.npz", **{k: v for k, v in arrays.items() if k != "t"})
    with zipfile.ZipFile(tmp_path / "bad.npz", "a") as archive:
        archive.writestr("t.npy", data)
    refused(tmp_path / "bad.npz", "'t'")


def test_text_that_is_none(tmp_path: Path, arrays: Arrays) -> None:
    bad = np.full(3, 0x7FFFFFFF, dtype=np.uint32).view("<U1")
    np.savez(tmp_path / "bad.npz", **{**arrays, "joint_names": bad})
    refused(tmp_path / "bad.npz", "array 'joint_names' holds what is no text")


def test_bombs_are_not_unpacked(tmp_path: Path) -> None:
    """200 MB of zeros in 200 kB, and the same once more by a reader that may use little memory."""
    bomb = tmp_path / "bomb.npz"
    with (
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("t.npy", "w", force_zip64=True) as member,
    ):
        for _ in range(200):
            member.write(bytes(1 << 20))
    assert bomb.stat().st_size < 1 << 20
    refused(bomb, "would unpack to far more than its size")
    code = (
        "import sys, resource\nfrom wbc.recording import Log\nfrom wbc.errors import WbcError\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try:\n    Log.load(sys.argv[1])\nexcept WbcError:\n"
        "    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, bomb], capture_output=True, text=True)
    assert int(done.stdout) < 50_000  # kB


def test_sizes_in_the_directory_that_lie(tmp_path: Path, arrays: Arrays) -> None:
    """A directory that claims 80 bytes of an entry that would unpack to megabytes."""
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in arrays:
            archive.writestr(f"{name}.npy", bytes(5 << 20))
        for entry in archive.infolist():
            entry.file_size = 80
    (tmp_path / "bad.npz").write_bytes(whole.getvalue())
    refused(tmp_path / "bad.npz", "")


def test_names_twice_and_far_too_many(tmp_path: Path, arrays: Arrays) -> None:
    np.savez(tmp_path / "twice.npz", **arrays)
    with zipfile.ZipFile(tmp_path / "twice.npz", "a") as archive, pytest.warns(UserWarning):
        archive.writestr("t.npy", b"")
    refused(tmp_path / "twice.npz", "two arrays 't'")
    np.savez(tmp_path / "many.npz", **arrays, **{f"x{k}": np.zeros(1) for k in range(400)})
    refused(tmp_path / "many.npz", "more than any such file has")


def test_places_that_hold_no_log(tmp_path: Path) -> None:
    refused(tmp_path / "none.npz", "No such file or directory")
    refused(tmp_path, "is not a regular file")
    refused(Path("/dev/zero"), "is not a regular file")
    os.mkfifo(tmp_path / "pipe")
    refused(tmp_path / "pipe", "is not a regular file")  # and does not wait for a writer
    (tmp_path / "empty.npz").touch()
    refused(tmp_path / "empty.npz", "is not a log of wbc")
    (tmp_path / "text.npz").write_text("t,q,v\n0,1,2\n")
    refused(tmp_path / "text.npz", "is not a log of wbc")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    refused(tmp_path / "other.npz", "is not a log of wbc: it has no array 'activation'")


def test_every_length_cut_short_is_refused(tmp_path: Path) -> None:
    recorded(20).save(tmp_path / "good.npz")
    data = (tmp_path / "good.npz").read_bytes()
    for length in range(0, len(data), 997):
        (tmp_path / "cut.npz").write_bytes(data[:length])
        refused(tmp_path / "cut.npz", "")


def test_flipped_bits_give_a_log_or_one_line(tmp_path: Path) -> None:
    recorded(20).save(tmp_path / "good.npz")
    good = (tmp_path / "good.npz").read_bytes()
    rng, refusals = random.Random(0), 0
    for _ in range(400):
        data = bytearray(good)
        for _ in range(rng.choice((1, 3, 20))):
            # the directory at the end and the headers are where it hurts
            at = rng.randrange(len(data) - 4000, len(data)) if rng.random() < 0.6 else None
            data[rng.randrange(len(data)) if at is None else at] ^= 1 << rng.randrange(8)
        (tmp_path / "bad.npz").write_bytes(bytes(data))
        try:
            Log.load(tmp_path / "bad.npz")
        except WbcError as error:
            refusals += 1
            assert "\n" not in str(error)
    assert refusals > 200

"""Named arrays in an ``.npz`` file: the same bytes for the same arrays, and no trust when read.

NumPy's own reader allocates what a header claims and inflates what the zip directory claims; both
are checked here first, and Python objects are never unpickled.
"""

from __future__ import annotations

import io
import math
import os
import stat
import sys
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from wbc.errors import WbcError
from wbc.files import write_whole

_EPOCH = (1980, 1, 1, 0, 0, 0)
_MOST_MEMBERS = 256
_FREE_SIZE = 64 << 20
_LAST = sys.maxunicode
_MOST_RATIO = 20  # a log stored as written here has ratio 1, a deflated one about 3


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> Path:
    """Write `arrays` uncompressed in their order; whole or not at all.

    Raises:
        WbcError: the file cannot be written.
    """
    return write_whole(path, lambda file: _fill(file, arrays))


def _fill(file: BinaryIO, arrays: Mapping[str, NDArray[Any]]) -> None:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
            entry.create_system = 3  # the same bytes on every system
            entry.external_attr = 0o644 << 16
            with archive.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)


def read_arrays(
    path: str | os.PathLike[str],
    names: Collection[str],
    *,
    what: str,
    optional: Collection[str] = (),
) -> dict[str, NDArray[Any]]:
    """The arrays called `names`, read-only; others in the file are not looked at.

    Args:
        what: what the file should be, for the messages, e.g. ``"a log of wbc"``.
        optional: names that are read where the file has them.

    Raises:
        WbcError: one line: no such file, not a zip, too large unpacked, an array missing or broken.
    """
    shown = os.fspath(path)
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
            raise WbcError(f"'{shown}' is not a regular file")
        with zipfile.ZipFile(path) as archive:
            members = _members(archive, status.st_size)
            missing = sorted(set(names) - set(members))
            if missing:
                raise WbcError(f"'{shown}' is not {what}: it has no array '{missing[0]}'")
            wanted = [*names, *(name for name in optional if name in members)]
            return {name: _array(name, archive.read(members[name])) for name in wanted}
    except WbcError as error:
        raise error if shown in str(error) else WbcError(f"'{shown}': {error}") from None
    except OSError as error:
        raise WbcError(f"cannot read '{shown}': {error.strerror or error}") from error
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError) as error:
        raise WbcError(f"'{shown}' is not {what}: a damaged or foreign file") from error


def _members(archive: zipfile.ZipFile, file_size: int) -> dict[str, zipfile.ZipInfo]:
    """Entries by array name, after a look at what they would unpack to."""
    entries = archive.infolist()
    if len(entries) > _MOST_MEMBERS:
        raise WbcError(f"{len(entries)} arrays, more than any such file has")
    if sum(e.file_size for e in entries) > max(_FREE_SIZE, _MOST_RATIO * file_size):
        raise WbcError("it would unpack to far more than its size; not read")
    found: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        name = entry.filename.removesuffix(".npy")
        if name in found:
            raise WbcError(f"two arrays '{name[:40]}'")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise WbcError(f"array '{name[:40]}' is packed in an unknown way")
        found[name] = entry
    return found


def _array(name: str, data: bytes) -> NDArray[Any]:
    """The array in `data`, a ``.npy`` file, if its header is true."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        if version == (1, 0):
            shape, by_column, dtype = np.lib.format.read_array_header_1_0(stream)
        elif version == (2, 0):
            shape, by_column, dtype = np.lib.format.read_array_header_2_0(stream)
        else:
            raise WbcError(f"array '{name}' has an unknown format")
    except WbcError:
        raise
    except Exception as error:  # NumPy hands the header to Python's own parsers: no list is whole
        raise WbcError(f"array '{name}' has a damaged header") from error
    if dtype.hasobject:
        raise WbcError(f"array '{name}' holds Python objects; not read")
    if dtype.kind not in "fiubU":
        raise WbcError(f"array '{name}' is of type {dtype}; numbers, booleans and text are read")
    rest = len(data) - stream.tell()
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != rest:
        raise WbcError(f"array '{name}' of shape {shape} does not fit its {rest} bytes")
    if rest == 0:
        return np.empty(shape, dtype)
    kind, start = dtype.kind, stream.tell()
    order: Literal["C", "F"] = "F" if by_column else "C"
    if kind == "U" and np.frombuffer(data, dtype.byteorder + "u4", offset=start).max() > _LAST:
        raise WbcError(f"array '{name}' holds what is no text")
    if kind == "b":  # a byte other than 0 and 1 is no bool; make it one
        truth: NDArray[Any] = np.frombuffer(data, np.uint8, offset=start) != 0
        return truth.reshape(shape, order=order)
    array: NDArray[Any] = np.frombuffer(data, dtype, offset=start)
    return array.reshape(shape, order=order)

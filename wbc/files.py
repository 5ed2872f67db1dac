"""Files that are either whole or not there: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from wbc.errors import WbcError


def write_whole(path: str | os.PathLike[str], fill: Callable[[BinaryIO], object]) -> Path:
    """Let `fill` write a file that appears at `path` complete and on disk, or not at all.

    Whatever goes wrong (no space, no permission, a folder in the way) leaves an older file at
    `path` as it was. Missing folders are made.

    Args:
        fill: writes the contents to the file it is given.

    Raises:
        WbcError: one line, with the reason of the system.
    """
    shown = os.fspath(path)
    try:
        target = Path(path).resolve()  # through a link: the file, not the link, is replaced
        if target.exists() and not target.is_file():
            # renaming onto a device would replace the device itself
            raise WbcError(f"cannot write '{shown}': it is not a regular file")
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
        try:
            with open(part, "xb") as file:
                fill(file)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, target)
        except BaseException:  # also Ctrl-C: no half file stays behind
            part.unlink(missing_ok=True)
            raise
        _sync_folder(target.parent)
    except (OSError, ValueError, RuntimeError) as error:
        # ValueError: a NUL in the path; RuntimeError: a loop of links
        reason = getattr(error, "strerror", None) or str(error)
        raise WbcError(f"cannot write '{shown}': {reason}") from error
    return target


def _sync_folder(folder: Path) -> None:
    """Make the rename itself durable, where the system lets a folder be opened."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass  # some network file systems refuse; the file's data is on disk already
    finally:
        os.close(handle)

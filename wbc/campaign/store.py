"""The folder of a campaign: what it is about, and a line for each trial done."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, final

from wbc.errors import WbcError
from wbc.files import write_whole

CAMPAIGN: Final = "campaign.json"
TRIALS: Final = "trials.jsonl"
REPORT: Final = "report.html"
_ABOUT: Final = ("scenario_sha256", "robot_sha256", "seed", "overrides", "varied", "versions")
"""What must be the same for trials to belong together."""


@final
class Store:
    """The trials done so far, each on disk as soon as it is done.

    Lines are appended in the order in which trials end, and put in the order of their numbers by
    `close`. A line that a killed process left unfinished is dropped.

    Attributes:
        lines: JSON by the trial's number.
    """

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        """Begin a campaign in `folder`, or go on with the one that is there.

        Args:
            about: what the campaign is, in plain values; of it `_ABOUT` decides.

        Raises:
            WbcError: the folder holds something else, is at work, or cannot be written.
        """
        self._folder = folder
        self._path = folder / TRIALS
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(folder, os.O_RDONLY)
        except (OSError, ValueError) as error:
            raise _unwritable(folder, error) from None
        try:
            self._take(about)
        except BaseException:
            os.close(self._lock)
            raise

    def _take(self, about: Mapping[str, Any]) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise WbcError(f"another sweep is at work in '{self._folder}'") from None
        plain = json.loads(json.dumps(about))
        try:
            self._agree(plain)
            self.lines, whole = _read(self._path)
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
            os.ftruncate(self._file, whole)
        except OSError as error:
            raise _unwritable(self._folder, error) from None

    def _agree(self, about: Mapping[str, Any]) -> None:
        path = self._folder / CAMPAIGN
        if not path.exists():
            if self._path.exists():
                raise WbcError(f"'{self._path}' is there, but no {CAMPAIGN} that says of what")
            text = json.dumps(about, indent=2) + "\n"
            write_whole(path, lambda file: file.write(text.encode()))
            return
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
            other = [key for key in _ABOUT if found.get(key) != about.get(key)]
        except (ValueError, AttributeError):
            raise WbcError(f"'{path}' cannot be read: it is no campaign of wbc") from None
        if other:
            what = ", ".join(_said(key, found.get(key), about.get(key)) for key in other)
            raise WbcError(
                f"'{self._folder}' holds the trials of another campaign: {what} "
                "(choose another --out, or delete the folder)"
            )

    def add(self, number: int, line: str) -> None:
        """Keep a trial. Raises WbcError when it cannot be written."""
        data = (line + "\n").encode()
        try:
            while data:
                data = data[os.write(self._file, data) :]
        except OSError as error:
            raise _unwritable(self._path, error) from None
        self.lines[number] = line

    def close(self) -> None:
        """Put the lines in order. Raises WbcError when they cannot be written."""
        text = "".join(f"{self.lines[number]}\n" for number in sorted(self.lines)).encode()
        try:
            if self._path.read_bytes() != text:
                write_whole(self._path, lambda file: file.write(text))
        finally:
            os.close(self._file)
            os.close(self._lock)


def _read(path: Path) -> tuple[dict[int, str], int]:
    """Lines by number, and how many bytes of the file are whole lines."""
    if not path.exists():
        return {}, 0
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    lines: dict[int, str] = {}
    for at, raw in enumerate(data[:whole].splitlines(), start=1):
        try:
            line = raw.decode()
            number = json.loads(line)["trial"]
            assert isinstance(number, int)
        except (ValueError, KeyError, TypeError, AssertionError):
            raise WbcError(f"{path}:{at}: is no trial: delete the line to do it again") from None
        lines.setdefault(number, line)
    return lines, whole


def _said(key: str, found: Any, asked: Any) -> str:
    if key == "scenario_sha256":
        return "its scenario's text differs"
    if key == "robot_sha256":
        return "its robot's description differs" if found else "it does not say of which robot"
    if key == "versions" and isinstance(found, dict) and isinstance(asked, dict):
        names = sorted(name for name in {*found, *asked} if found.get(name) != asked.get(name))
        return ", ".join(
            f"{name} {found.get(name, 'not')} there, {asked.get(name, 'not')} now" for name in names
        )
    return f"{key} {_short(found)} there, {_short(asked)} now"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _unwritable(path: Path, error: Exception) -> WbcError:
    reason = getattr(error, "strerror", None) or str(error)
    return WbcError(f"cannot write to '{path}': {reason} (choose a folder by --out)")

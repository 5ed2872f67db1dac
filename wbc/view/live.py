"""The live view as the controller sees it: publish and forget."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
import weakref
from pathlib import Path

from wbc.view.scene import Scene, Snapshot
from wbc.view.slot import Layout, SlotWriter, anonymous_file

HOST = "127.0.0.1"
FIRST_PORT = 7000
_PORTS = 200
_PERIOD = 1.0 / 60.0
_PACKAGE_ROOT = Path(__file__).resolve().parents[2]


class LiveView:
    """A page on this machine that follows a run; its server is a process of its own.

    The page answers from the start, a little slowly in the first second. Nothing the viewer does
    reaches the caller: a port already taken means the next free one, a missing browser means
    nothing, and a viewer that died leaves `publish` a write into memory nobody reads.

        with LiveView(scene, open_browser=True) as view:
            print(view.url)
            ...
            if view.due():
                view.publish(snapshot)
            if line := view.warning():
                print(line)
    """

    def __init__(self, scene: Scene, port: int | None = None, open_browser: bool = False) -> None:
        self.url = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._writer: SlotWriter | None = None
        self._trouble = ""
        self._warned = False
        self._closed = False
        self._next = 0.0
        self._finalizer: weakref.finalize[..., LiveView] | None = None
        try:
            self._start(scene, FIRST_PORT if port is None else port, open_browser)
        except (OSError, ValueError) as error:
            self._trouble = str(error)

    def _start(self, scene: Scene, port: int, open_browser: bool) -> None:
        layout = Layout.of(scene)
        with contextlib.ExitStack() as stack:
            listener = stack.enter_context(_listen(port))
            scene_fd = anonymous_file(0)
            stack.callback(os.close, scene_fd)
            with os.fdopen(os.dup(scene_fd), "wb") as file:
                pickle.dump(scene, file)
            slot_fd = anonymous_file(layout.total_bytes)
            stack.callback(os.close, slot_fd)
            alive_read, alive_write = os.pipe()
            stack.callback(os.close, alive_read)
            descriptors = {
                "listen": listener.fileno(),
                "scene": scene_fd,
                "slot": slot_fd,
                "alive": alive_read,
            }
            try:
                self._writer = SlotWriter(slot_fd, layout)
                self._process = _spawn(descriptors, open_browser)
            except BaseException:
                os.close(alive_write)
                raise
            self.url = f"http://{HOST}:{listener.getsockname()[1]}/"
        self._finalizer = weakref.finalize(self, _end, self._process, alive_write, os.getpid())

    def publish(self, snapshot: Snapshot) -> None:
        """Make `snapshot` the one to draw. Microseconds; never waits and never raises."""
        if self._writer is None or self._closed:
            return
        try:
            self._writer.write(snapshot)
        except Exception as error:  # no picture is worth a control tick
            self._trouble = f"a snapshot does not fit the scene ({error})"

    def due(self) -> bool:
        """True at most sixty times a second: whoever has to make a snapshot first asks this."""
        now = time.monotonic()
        if now < self._next or self._closed:
            return False
        self._next = now + _PERIOD
        return True

    @property
    def alive(self) -> bool:
        """Whether the viewer process runs."""
        return not self._closed and self._process is not None and self._process.poll() is None

    @property
    def browsers(self) -> int:
        """Pages that follow at this moment."""
        return self._writer.browsers if self.alive and self._writer is not None else 0

    @property
    def drawn(self) -> int:
        """Number of the last published snapshot that the viewer took, counted from 1."""
        return self._writer.drawn if self._writer is not None else 0

    def wait_for_browser(self, timeout: float) -> bool:
        """Wait until a page follows. For replays; a controller has no reason to call it."""
        until = time.monotonic() + timeout
        while self.browsers == 0:
            if not self.alive or time.monotonic() > until:
                return False
            time.sleep(0.02)
        return True

    def warning(self) -> str | None:
        """One line if something is wrong with the view, the first time it is asked for."""
        if self._warned or self._closed or (self.alive and not self._trouble):
            return None
        self._warned = True
        if self.alive:
            return f"live view: {self._trouble}"
        return f"the live view is gone ({self._reason()}); the run goes on without it"

    def _reason(self) -> str:
        if self._process is None:
            return self._trouble or "it could not be started"
        words = self._writer.last_words if self._writer is not None else ""
        code = self._process.returncode
        if words:
            return words
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"ended by {signal.Signals(-code).name}"
        return f"ended with code {code}"

    def close(self) -> None:
        """End the viewer. Publishing afterwards does nothing."""
        self._closed = True
        if self._finalizer is not None:
            self._finalizer()
        self._writer = None

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _listen(first: int) -> socket.socket:
    """A listening socket on the loopback interface: the first free port from `first` on.

    The controller's process binds it and hands it over, so the address is known at once and no
    other program can take the port in between.
    """
    for port in [*range(first, min(first + _PORTS, 65536)), 0]:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((HOST, port))
            listener.listen(16)
        except OSError:
            listener.close()
            continue
        return listener
    raise OSError("no free port on the loopback interface")


def _spawn(descriptors: dict[str, int], open_browser: bool) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "wbc.view.process", "--parent", str(os.getpid())]
    for name, fd in descriptors.items():
        command += [f"--{name}", str(fd)]
    if open_browser:
        command.append("--open")
    # The child must find what this process finds, and nothing by accident in the user's folder.
    paths = [os.path.abspath(p) for p in sys.path if p]
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=tuple(descriptors.values()),
        cwd=_PACKAGE_ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        start_new_session=True,  # Ctrl-C is for the run; the viewer goes when the run closes it
    )


def _end(process: subprocess.Popen[bytes], alive_write: int, owner: int) -> None:
    """Let go of the viewer: first by closing its pipe, then less politely."""
    os.close(alive_write)
    if os.getpid() != owner:
        return  # a fork of the controller's process ends; the viewer is not its to stop
    for stop, patience in ((None, 2.0), (process.terminate, 1.0), (process.kill, None)):
        if stop is not None:
            stop()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)
            return

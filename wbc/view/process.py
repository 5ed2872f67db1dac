"""The viewer process: `python -m wbc.view.process`, started by `LiveView` and by nobody else.

It inherits its listening socket, the scene, the slot and the end of a pipe that closes when the
controller's process is gone. Imports of weight happen in `_serve`, so that what goes wrong there
can be told.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys

FRAME_PERIOD = 1.0 / 30.0
_NICENESS = 5


def main() -> int:
    """Serve until the pipe closes or the parent changes; 1 if that was not possible."""
    parser = argparse.ArgumentParser(prog="wbc.view.process")
    for name in ("listen", "scene", "slot", "alive", "parent"):
        parser.add_argument(f"--{name}", type=int, required=True)
    parser.add_argument("--open", action="store_true", help="show the page in the user's browser")
    options = parser.parse_args()
    for fd in (options.listen, options.scene, options.slot, options.alive):
        os.set_inheritable(fd, False)  # else a browser started below would keep the port taken
    with contextlib.suppress(OSError):
        os.nice(_NICENESS)  # the control tick goes first
    try:
        _serve(options)
    except Exception as error:
        with contextlib.suppress(Exception):
            from wbc.view.slot import leave_words

            leave_words(options.slot, f"{type(error).__name__}: {error}")
        return 1
    return 0


def _serve(options: argparse.Namespace) -> None:
    import asyncio
    import logging
    import pickle
    import socket

    from tornado.httpserver import HTTPServer

    from wbc.view.server import Picture, application
    from wbc.view.slot import Layout, SlotReader

    logging.disable(logging.CRITICAL)  # nobody reads it
    with os.fdopen(options.scene, "rb") as file:
        file.seek(0)
        scene = pickle.load(file)
    reader = SlotReader(options.slot, Layout.of(scene))
    picture = Picture(scene)

    async def follow() -> None:
        listener = socket.socket(fileno=options.listen)
        listener.setblocking(False)
        HTTPServer(application(picture)).add_socket(listener)
        over = asyncio.Event()
        asyncio.get_running_loop().add_reader(options.alive, over.set)
        if options.open:
            host, port = listener.getsockname()[:2]
            _open_browser(f"http://{host}:{port}/")
        # A process forked by the controller may hold the pipe open, hence the look at the parent.
        while not over.is_set() and os.getppid() == options.parent:
            picture.show(reader.read())
            reader.tell_browsers(len(picture.followers))
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(over.wait(), FRAME_PERIOD)
        picture.text = ""  # the last state goes out whole
        picture.show(reader.read())
        reader.tell_browsers(0)
        for follower in tuple(picture.followers):
            follower.close()
        await asyncio.sleep(0.05)

    asyncio.run(follow())


def _open_browser(url: str) -> None:
    """In a thread: some browsers block, and a machine without one is no fault."""
    import threading
    import webbrowser

    threading.Thread(target=webbrowser.open, args=(url, 2), daemon=True).start()


if __name__ == "__main__":
    sys.exit(main())

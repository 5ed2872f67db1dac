"""The web server of the live view: one page, its script, and a web socket per open page.

It is meshcat's page and protocol without meshcat's own server, which listens on every interface,
blocks its client for ever when it dies, and keeps a copy of each property ever set.
"""

from __future__ import annotations

import json
from collections.abc import Awaitable
from typing import Any

import tornado.httpserver
import tornado.web
import tornado.websocket

from wbc.view.draw import Commands, fixed_commands, moving_commands
from wbc.view.panel import meshcat_script, page, page_file, panel_info, panel_state
from wbc.view.scene import Scene, Snapshot

PANEL_EVERY = 3
"""Frames per refresh of the panel: text that changes 30 times a second cannot be read."""


class _Follower(tornado.websocket.WebSocketHandler):
    """One open page. Remembers what it was sent: a slow page skips frames, they do not pile up."""

    def initialize(self, picture: Picture) -> None:
        self._picture = picture
        self._sent: Commands = {}
        self._sent_text = ""
        self._flushed: Any = None

    def open(self, *_args: str, **_kwargs: str) -> None:
        self.set_nodelay(True)
        self._picture.followers.add(self)
        self._flushed = self.write_message(self._picture.greeting)
        self.catch_up(self._picture.commands, self._picture.text)

    def on_message(self, message: str | bytes) -> Awaitable[None] | None:
        """The page has nothing to say."""
        return None

    def on_close(self) -> None:
        self._picture.followers.discard(self)

    @property
    def busy(self) -> bool:
        """Whether earlier messages are still on their way."""
        return self._flushed is not None and not self._flushed.done()

    def catch_up(self, commands: Commands, text: str) -> None:
        """Send what differs from what this page has."""
        try:
            for key, data in commands.items():
                if self._sent.get(key) != data:
                    self._sent[key] = data
                    self._flushed = self.write_message(data, binary=True)
            if text and text != self._sent_text:
                self._sent_text = text
                self._flushed = self.write_message(text)
        except tornado.websocket.WebSocketClosedError:
            self.on_close()


class Picture:
    """The present state of the drawing, and the pages that follow it."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.followers: set[_Follower] = set()
        self.greeting = json.dumps({"info": panel_info(scene)}, allow_nan=False)
        self.commands = fixed_commands(scene)
        self.text = ""
        self._latest: Snapshot | None = None
        self._frame = 0

    def show(self, snapshot: Snapshot | None) -> None:
        """Take the latest snapshot, if there is one, and bring every idle page up to date."""
        if snapshot is not None:
            self._latest = snapshot
            self.commands.update(moving_commands(self.scene, snapshot))
        self._frame += 1
        if self._latest is not None and (self._frame % PANEL_EVERY == 0 or not self.text):
            self.text = json.dumps({"state": panel_state(self._latest)}, allow_nan=False)
        for follower in tuple(self.followers):
            if not follower.busy:
                follower.catch_up(self.commands, self.text)


class _Text(tornado.web.RequestHandler):
    """A fixed text."""

    def initialize(self, text: str, kind: str) -> None:
        self._text, self._kind = text, kind

    def get(self) -> None:
        self.set_header("Content-Type", f"{self._kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-store")
        self.finish(self._text)


def application(picture: Picture) -> tornado.web.Application:
    """The pages, for requests that name this machine only.

    The check of the host name keeps a web site from reaching the robot's viewer through a name
    that it lets point to 127.0.0.1; Tornado's own check of the origin covers the rest.
    """
    scripts = "\n".join(
        f'<script src="{name}"></script>' for name in ("meshcat.js", "panel.js", "live.js")
    )
    files = [
        (r"/", page(picture.scene.title, "", scripts), "text/html"),
        (r"/meshcat\.js", meshcat_script(), "text/javascript"),
        (r"/panel\.js", page_file("panel.js"), "text/javascript"),
        (r"/live\.js", page_file("live.js"), "text/javascript"),
    ]
    rules: list[Any] = [(path, _Text, {"text": text, "kind": kind}) for path, text, kind in files]
    rules.append((r"/follow", _Follower, {"picture": picture}))
    app = tornado.web.Application(log_function=lambda handler: None)
    app.add_handlers(r"(127\.0\.0\.1|localhost)", rules)
    return app

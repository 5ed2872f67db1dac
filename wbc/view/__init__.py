"""The live view: meshcat in a process of its own, replays, and runs as one HTML file.

`write_html` is imported on first use: it loads meshcat, which a controller has no need of.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from wbc.view.live import LiveView
from wbc.view.meshes import extrude
from wbc.view.replay import replay
from wbc.view.scene import ObjectShape, Scene, SceneShape, Snapshot

if TYPE_CHECKING:
    from wbc.view.html import write_html

__all__ = [
    "LiveView",
    "ObjectShape",
    "Scene",
    "SceneShape",
    "Snapshot",
    "extrude",
    "replay",
    "write_html",
]


def __getattr__(name: str) -> Any:
    if name == "write_html":
        from wbc.view.html import write_html

        return write_html
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""The text panel beside the scene, and the page both of the live view and of the exported file."""

from __future__ import annotations

import html
import json
import math
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wbc.errors import WbcError
from wbc.view import arrows
from wbc.view.draw import STATES
from wbc.view.scene import Scene, Snapshot

_PAGE = Path(__file__).resolve().parent / "page"


def _number(value: float) -> float | None:
    """JSON has no NaN."""
    return float(value) if math.isfinite(value) else None


def _rounded(value: float) -> float | None:
    """Two digits."""
    return _number(float(f"{float(value):.2g}"))


def _css(rgba: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * c):02x}" for c in rgba[:3])


def panel_info(scene: Scene) -> dict[str, Any]:
    """What the page needs once: names, and where the camera stands."""
    return {
        "title": scene.title,
        "tasks": list(scene.task_names),
        "contacts": list(scene.contact_names),
        "phases": list(scene.phase_names),
        "colors": [_css(color) for color in STATES],
        "legend": [[name, _css(color)] for name, color in arrows.legend(scene).items()],
        "view": {
            "planar": scene.planar,
            "center": [float(c) for c in scene.center],
            "extent": float(scene.extent),
            "towards": [float(c) for c in scene.towards],
        },
    }


def panel_state(snapshot: Snapshot) -> dict[str, Any]:
    """What the panel shows of one instant, rounded to what can be seen."""
    return {
        "t": round(float(snapshot.t), 3),
        "phase": int(snapshot.phase),
        "in": [int(bool(b)) for b in snapshot.in_stack],
        "act": [round(float(a), 2) if math.isfinite(a) else 0.0 for a in snapshot.activation],
        "con": [int(c) for c in snapshot.contact_mode],
        "eps": [_rounded(e) for e in (snapshot.eps_f, snapshot.eps_m)],
        "err": [_rounded(e) for e in snapshot.error],
        "dist": _rounded(snapshot.distance),
        "status": snapshot.status,
        "text": snapshot.text,
    }


def script_json(value: Any) -> str:
    """JSON that can stand inside a script element, whatever the names in it."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c").replace("\u2028", "\\u2028")


@cache
def page_file(name: str) -> str:
    """A file of the page that travels with this package."""
    return (_PAGE / name).read_text(encoding="utf-8")


@cache
def meshcat_script() -> str:
    """The viewer's JavaScript, from the installed meshcat (not imported for that)."""
    found = find_spec("meshcat")
    if found is None or found.origin is None:
        raise WbcError("the live view needs meshcat; install it with: pip install meshcat")
    return (Path(found.origin).parent / "viewer" / "dist" / "main.min.js").read_text("utf-8")


def page(title: str, head: str, scripts: str) -> str:
    """A whole page: the pane, the panel and the given scripts."""
    return (
        page_file("page.html")
        .replace("%TITLE%", html.escape(title))
        .replace("%HEAD%", head)
        .replace("%STYLE%", page_file("page.css"))
        .replace("%SCRIPTS%", scripts)
    )

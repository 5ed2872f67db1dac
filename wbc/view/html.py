"""A run as one HTML file that plays by itself and asks nothing of any network."""

from __future__ import annotations

import base64
import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import NDArray

from wbc.arrays import Array, BoolArray
from wbc.errors import WbcError
from wbc.view import arrows
from wbc.view.draw import (
    STATES,
    fixed_commands,
    moving_commands,
    node,
    pack,
    poses,
    tip_colors,
    tip_states,
    tips,
)
from wbc.view.panel import meshcat_script, page, page_file, panel_info, panel_state, script_json
from wbc.view.scene import Scene, Snapshot, quaternions

# The browser itself refuses whatever would leave the file.
_CLOSED = (
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
    "script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    'img-src data: blob:; connect-src data: blob:; worker-src blob:">\n'
)
_FLOAT32 = 0x17
_DISCRETE = 2300
_STILL = 1.0
"""Seconds the last frame stands before the film starts again."""


def write_html(
    path: str | os.PathLike[str], scene: Scene, snapshots: Sequence[Snapshot], fps: float = 30.0
) -> Path:
    """Write the whole run to `path`; the file appears complete or not at all.

    Args:
        fps: most frames kept per second of the run; the browser interpolates between them.
    """
    if not snapshots:
        raise WbcError("nothing to export: the run has no records")
    kept = _thin(snapshots, fps)
    commands = fixed_commands(scene) | moving_commands(scene, kept[0])
    commands["", "animation"] = _animation(scene, kept)
    t0 = float(kept[0].t)
    data = {
        "info": panel_info(scene),
        "commands": [base64.b64encode(c).decode("ascii") for c in commands.values()],
        "times": [round(float(s.t) - t0, 4) for s in kept],
        "states": [panel_state(s) for s in kept],
    }
    scripts = [
        f"<script>{meshcat_script()}</script>",
        f'<script type="application/json" id="wbc-data">{script_json(data)}</script>',
        f"<script>{page_file('panel.js')}</script>",
        f"<script>{page_file('export.js')}</script>",
    ]
    return _write(Path(path), page(scene.title, _CLOSED, "\n".join(scripts)))


def _write(path: Path, text: str) -> Path:
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(name, 0o644)
            os.replace(name, path)
        except BaseException:
            os.unlink(name)
            raise
    except OSError as error:
        raise WbcError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def _thin(snapshots: Sequence[Snapshot], fps: float) -> list[Snapshot]:
    """At most `fps` snapshots per second, always with the first and the last."""
    t = np.array([s.t for s in snapshots], dtype=np.float64)
    if not np.isfinite(t).all() or bool((np.diff(t) < 0.0).any()):
        raise WbcError("cannot export: the times of the run are not in order")
    frame = np.floor((t - t[0]) * fps + 1e-6)
    keep = np.flatnonzero(np.diff(frame, prepend=-1.0) > 0.0).tolist()
    if keep[-1] != len(t) - 1:
        keep.append(len(t) - 1)
    return [snapshots[i] for i in keep]


def _track(name: str, kind: str, times: Array, values: Array, **more: Any) -> dict[str, Any]:
    """Keys of one property; those between two equal ones are left out.

    Args:
        times: (n,); values: (n, k).
    """
    values = np.asarray(values, dtype=np.float32)
    same = (values[1:] == values[:-1]).all(axis=1)
    keep = np.ones(len(values), dtype=bool)
    keep[1:-1] = ~(same[1:] & same[:-1])
    kept = values[keep]
    packed = [bool(v) for v in kept[:, 0]] if kind == "bool" else _floats(kept)
    return {
        "name": f".{name}", "type": kind, "times": _floats(times[keep]), "values": packed, **more
    }  # fmt: skip


def _floats(values: Array) -> Any:
    return umsgpack.Ext(_FLOAT32, np.ascontiguousarray(values, dtype="<f4").tobytes())


def _animation(scene: Scene, snapshots: Sequence[Snapshot]) -> bytes:
    """meshcat's animation command, with packed arrays in place of one object per key.

    Every track has its last key at the same time: each node repeats after its own last key.
    """
    t = np.array([s.t for s in snapshots], dtype=np.float64)
    times = np.append(t - t[0], t[-1] - t[0] + _STILL)
    frames = [poses(scene, s) for s in snapshots]
    clips = []
    for path in frames[0]:
        tracks = _pose_tracks(times, _held(np.stack([f[path] for f in frames])))
        clips.append(_clip(path, tracks))
    modes = _held(np.stack([np.asarray(s.contact_mode, dtype=np.int64) for s in snapshots]))
    states = _held(np.stack([tip_states(s) for s in snapshots]))
    column = {name: i for i, name in enumerate(scene.contact_names)}
    painted: dict[str, tuple[NDArray[Any], Sequence[tuple[float, ...]]]] = {
        path: (states[:, column[shape.finger or ""]], tip_colors(shape))
        for path, shape in tips(scene).items()
    }
    for name in scene.contact_names:
        for part in (("point",), ("normal", "shaft"), ("normal", "head")):
            painted[node("contacts", name, *part)] = (modes[:, column[name]], STATES)
    for path, (shown, colors) in painted.items():
        values = np.array([c[:3] for c in colors])[shown]
        track = _track("material.color", "color", times, values, interpolation=_DISCRETE)
        clips.append(_clip(path + "/<object>", [track]))
    clips += _force_colors(scene, snapshots, times)
    options = {"play": True, "repetitions": math.inf}
    return pack({"type": "set_animation", "path": "", "animations": clips, "options": options})


def _force_colors(scene: Scene, snapshots: Sequence[Snapshot], times: Array) -> list[Any]:
    shown = [arrows.colors(scene, s.forces) for s in snapshots]
    clips = []
    for names in shown[0]:
        values = _held(np.array([colors[names][:3] for colors in shown]))
        track = _track("material.color", "color", times, values, interpolation=_DISCRETE)
        clips.append(_clip(node(*names) + "/<object>", [track]))
    return clips


def _clip(path: str, tracks: list[dict[str, Any]]) -> dict[str, Any]:
    return {"path": path, "clip": {"name": "run", "fps": 1, "tracks": tracks}}


def _held(values: NDArray[Any]) -> NDArray[Any]:
    """With the last value once more, for the time the last frame stands."""
    return np.concatenate((values, values[-1:]))


def _pose_tracks(times: Array, matrices: Array) -> list[dict[str, Any]]:
    known: BoolArray = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    tracks = (
        [] if known.all() else [_track("visible", "bool", times, known[:, None].astype(np.float64))]
    )
    if known.any():
        # Where a pose is missing the node is hidden and waits at the last place it had.
        last = np.maximum.accumulate(np.where(known, np.arange(len(known)), int(known.argmax())))
        filled = matrices[last]
        scale = np.linalg.norm(filled[:, :3, :3], axis=1)
        if not np.allclose(scale, 1.0, rtol=0.0, atol=1e-9):  # only arrows change their length
            filled[:, :3, :3] /= scale[:, None, :]
            tracks.append(_track("scale", "vector", times, scale))
        tracks.append(_track("position", "vector", times, filled[:, :3, 3]))
        tracks.append(_track("quaternion", "quaternion", times, quaternions(filled)))
    return tracks

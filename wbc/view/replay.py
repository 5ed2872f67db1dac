"""A finished run shown again at its own pace."""

from __future__ import annotations

import time
from collections.abc import Sequence

from wbc.view.live import LiveView
from wbc.view.scene import Scene, Snapshot

_FRAME = 1.0 / 60.0


def replay(
    scene: Scene,
    snapshots: Sequence[Snapshot],
    rate: float = 1.0,
    *,
    view: LiveView | None = None,
    port: int | None = None,
    open_browser: bool = False,
    wait: float = 0.0,
    repeat: bool = False,
) -> bool:
    """Show `snapshots` in real time, `rate` times as fast.

    Args:
        view: show them here and leave it open; by default a view of its own, closed at the end.
        wait: seconds to wait for a page before starting; a replay nobody saw has no use.
        repeat: start again from the first, until the view ends or Ctrl-C.

    Returns:
        Whether the view lived to the end.
    """
    if view is None:
        with LiveView(scene, port, open_browser) as own:
            return replay(scene, snapshots, rate, view=own, wait=wait, repeat=repeat)
    if wait > 0.0:
        view.wait_for_browser(wait)
    _play(view, snapshots, rate)
    while repeat and view.alive and snapshots:
        time.sleep(1.0)
        _play(view, snapshots, rate)
    return view.alive


def _play(view: LiveView, snapshots: Sequence[Snapshot], rate: float) -> None:
    start = time.monotonic()
    shown = -1
    while view.alive and shown < len(snapshots) - 1:
        now = snapshots[0].t + rate * (time.monotonic() - start)
        due = shown
        while due < len(snapshots) - 1 and snapshots[due + 1].t <= now:
            due += 1
        if due != shown:
            shown = due
            view.publish(snapshots[shown])
        time.sleep(_FRAME)

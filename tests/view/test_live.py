"""The live view in a real process: it never reaches the run, and the run's end takes it along."""

from __future__ import annotations

import contextlib
import gc
import http.client
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wbc.view import LiveView, replay
from wbc.view.live import FIRST_PORT

from .demo import demo_scene, demo_snapshot
from .processes import listening, open_files, running, shared_maps, wait_until

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/net/tcp").exists(), reason="asks the Linux kernel about sockets"
)
TESTS = Path(__file__).resolve().parents[1]


@pytest.fixture
def view():
    with LiveView(demo_scene()) as opened:
        yield opened


def pid_of(view: LiveView) -> int:
    return view._process.pid


def port_of(view: LiveView) -> int:
    return int(view.url.rstrip("/").rsplit(":", 1)[1])


def get(view: LiveView, path: str = "/", **headers: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port_of(view), timeout=20)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def drawn(view: LiveView) -> bool:
    """Publish until the viewer has taken something: it takes a moment to start."""
    view.publish(demo_snapshot(0.0))
    return view.drawn > 0


def test_snapshots_arrive(view):
    assert view.url.startswith("http://127.0.0.1:")
    assert wait_until(lambda: drawn(view))
    view.publish(demo_snapshot(1.0))
    last = view._writer.written
    assert wait_until(lambda: view.drawn == last)
    assert view.alive
    assert view.warning() is None
    assert view.browsers == 0


def test_every_socket_listens_on_loopback_only(view):
    assert wait_until(lambda: drawn(view))
    assert get(view)[0] == 200
    addresses = listening(pid_of(view))
    assert addresses == [f"0100007F:{port_of(view):04X}"]
    assert listening(os.getpid()).count(addresses[0]) == 0, "the port outlives a killed viewer"


def test_the_page_and_its_scripts(view):
    status, page = get(view)
    assert status == 200
    assert b"two boxes" in page
    for script in ("meshcat.js", "panel.js", "live.js"):
        assert f'src="{script}"'.encode() in page
        assert get(view, f"/{script}")[0] == 200
    assert get(view, "/etc/passwd")[0] == 404


def test_other_names_and_other_sites_are_refused(view):
    assert get(view, Host=f"localhost:{port_of(view)}")[0] == 200
    assert get(view, Host="evil.example")[0] == 404
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    assert get(view, "/follow", Origin="http://evil.example", **upgrade)[0] == 403


def test_a_taken_port_means_the_next_free_one():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with LiveView(demo_scene(), port=port) as view:
            assert port_of(view) != port
            assert wait_until(lambda: drawn(view))


def test_two_views_at_once():
    with LiveView(demo_scene()) as one, LiveView(demo_scene()) as two:
        assert port_of(one) >= FIRST_PORT
        assert port_of(one) != port_of(two)
        assert wait_until(lambda: drawn(one) and drawn(two))


def test_a_killed_viewer_does_not_touch_the_run(view):
    assert wait_until(lambda: drawn(view))
    slowest = 0.0
    for k in range(2000):
        if k == 1000:
            os.kill(pid_of(view), signal.SIGKILL)
        start = time.perf_counter()
        view.publish(demo_snapshot(0.001 * k))
        slowest = max(slowest, time.perf_counter() - start)
    assert slowest < 0.5, "publish waited for a dead viewer"
    assert wait_until(lambda: not view.alive)
    line = view.warning()
    assert "SIGKILL" in line
    assert "\n" not in line
    assert view.warning() is None, "the same line twice"
    assert view.browsers == 0
    start = time.perf_counter()
    view.close()
    assert time.perf_counter() - start < 1.0


def test_a_stopped_viewer_is_ended_all_the_same():
    view = LiveView(demo_scene())
    assert wait_until(lambda: drawn(view))
    pid = pid_of(view)
    os.kill(pid, signal.SIGSTOP)
    for k in range(1000):
        view.publish(demo_snapshot(0.001 * k))
    view.close()
    assert not running(pid)


def test_closing_leaves_nothing_behind():
    gc.collect()
    maps, files, segments = shared_maps(), open_files(), set(os.listdir("/dev/shm"))
    view = LiveView(demo_scene())
    pid = pid_of(view)
    assert wait_until(lambda: drawn(view))
    port = port_of(view)
    assert not {n for n in os.listdir("/dev/shm") if "wbc" in n} - segments
    view.close()
    view.close()
    assert not view.alive
    assert not running(pid)
    view.publish(demo_snapshot(1.0))
    assert view.warning() is None, "closed on purpose"
    with socket.create_server(("127.0.0.1", port)):
        pass
    gc.collect()
    assert (shared_maps(), open_files()) == (maps, files)


def test_a_forgotten_view_ends_with_its_last_reference():
    view = LiveView(demo_scene())
    pid = pid_of(view)
    del view
    gc.collect()
    assert not running(pid)


def test_a_fork_of_the_run_leaves_the_viewer_alone(view):
    assert wait_until(lambda: drawn(view))
    pid = os.fork()
    if pid == 0:
        view._finalizer()
        os._exit(0)
    os.waitpid(pid, 0)
    time.sleep(0.3)
    assert view.alive


PARENT = """
import os, sys, time
sys.path[:0] = sys.argv[3:]
sys.argv[:2] = sys.argv[1:3]
from view.demo import demo_scene, demo_snapshot
from wbc.view import LiveView
view = LiveView(demo_scene())
while not view.drawn:
    view.publish(demo_snapshot(0.0))
    time.sleep(0.01)
if sys.argv[0] == "fork" and os.fork() == 0:
    time.sleep(60)
print(view._process.pid, flush=True)
time.sleep(float(sys.argv[1]))
"""


def start_parent(kind: str = "plain", seconds: float = 60.0) -> tuple[subprocess.Popen[str], int]:
    command = [sys.executable, "-W", "error", "-c", PARENT, kind, str(seconds)]
    command += [str(TESTS), str(TESTS.parent)]
    parent = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    return parent, int(parent.stdout.readline())


@pytest.mark.parametrize("kind", ["plain", "fork"])
def test_a_killed_run_takes_the_viewer_along(kind):
    """Also when a fork of the run still holds the pipe open."""
    parent, pid = start_parent(kind)
    try:
        assert running(pid)
        parent.kill()
        assert wait_until(lambda: not running(pid), 5.0)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(parent.pid, signal.SIGKILL)  # the fork, where there is one
        parent.communicate()


def test_ctrl_c_is_not_for_the_viewer_but_ends_it():
    parent, pid = start_parent()
    os.killpg(parent.pid, signal.SIGINT)
    _, errors = parent.communicate(timeout=20)
    assert "KeyboardInterrupt" in errors
    assert wait_until(lambda: not running(pid), 5.0)


def test_a_run_that_ends_without_closing_says_nothing():
    parent, pid = start_parent(seconds=0.0)
    _, errors = parent.communicate(timeout=20)
    assert (parent.returncode, errors) == (0, "")
    assert not running(pid)


def test_a_snapshot_that_does_not_fit_warns_once(view):
    good = demo_snapshot(0.0)
    view.publish(replace(good, activation=np.zeros(9)))
    line = view.warning()
    assert "does not fit" in line
    assert "\n" not in line
    for bad in (None, "x", replace(good, bodies=None), replace(good, text=7)):
        view.publish(bad)
    assert view.warning() is None
    assert view.alive
    assert wait_until(lambda: drawn(view))


def test_no_viewer_at_all(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    files = open_files()
    with LiveView(demo_scene()) as view:
        view.publish(demo_snapshot(0.0))
        assert not view.alive
        assert "/nowhere/python" in view.warning()
        assert not view.wait_for_browser(5.0)
    assert open_files() == files


def test_a_scene_the_viewer_cannot_draw_is_told():
    scene = demo_scene()
    scene = replace(scene, object=replace(scene.object, vertices=np.zeros((3, 2))))
    with LiveView(scene) as view:
        assert wait_until(lambda: not view.alive)
        assert "Error" in view.warning()


def test_a_page_that_does_not_read_holds_up_nobody(view):
    assert wait_until(lambda: drawn(view))
    with socket.create_connection(("127.0.0.1", port_of(view))) as sleeper:
        sleeper.sendall(
            f"GET /follow HTTP/1.1\r\nHost: 127.0.0.1:{port_of(view)}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        assert view.wait_for_browser(10.0)
        for k in range(100):
            view.publish(demo_snapshot(0.1 * k))
            time.sleep(0.01)
        last = view._writer.written
        assert wait_until(lambda: view.drawn == last, 5.0)
        assert get(view)[0] == 200
    assert wait_until(lambda: view.browsers == 0)


def test_replay_keeps_real_time(view):
    assert wait_until(lambda: drawn(view))
    before = view._writer.written
    run = [demo_snapshot(5.0 + 0.002 * k) for k in range(501)]
    start = time.monotonic()
    assert replay(demo_scene(), run, rate=2.0, view=view)
    assert 0.45 < time.monotonic() - start < 2.0
    assert 5 < view._writer.written - before < 120, "sixty a second are enough"
    assert view.alive


def test_due_is_said_sixty_times_a_second(view):
    start, said = time.monotonic(), 0
    while time.monotonic() - start < 0.5:
        said += view.due()
    assert 10 <= said <= 32
    view.close()
    assert not view.due()


def test_the_browser_is_shown_the_page_and_inherits_nothing(tmp_path, monkeypatch):
    script, told = tmp_path / "browser", tmp_path / "told"
    script.write_text(
        f'#!/bin/sh\nls -l /proc/$$/fd > "{told}.part"; echo "$1" >> "{told}.part"\n'
        f'mv "{told}.part" "{told}"\n'
    )
    script.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{script} %s")
    with LiveView(demo_scene(), open_browser=True) as view:
        assert wait_until(told.exists)
        lines = told.read_text().splitlines()
        assert lines[-1] == view.url
        assert not [line for line in lines if "socket:" in line or "memfd" in line]


def test_no_browser_means_nothing(monkeypatch):
    monkeypatch.setenv("BROWSER", "/nowhere/browser")
    with LiveView(demo_scene(), open_browser=True) as view:
        assert wait_until(lambda: drawn(view))
        assert view.warning() is None


def test_replay_of_nothing(view):
    assert replay(demo_scene(), [], view=view)

"""The pages in a real browser: Debian's Chromium, driven by Playwright's client."""

from __future__ import annotations

import io
import os
import threading
import time
from dataclasses import replace

import matplotlib.image
import numpy as np
import pinocchio as pin
import pytest

from wbc.view import LiveView, write_html
from wbc.view.forces import ArrowMaker
from wbc.view.from_robot import SnapshotMaker, robot_scene
from wbc.view.scene import ForceArrows

from .demo import demo_scene, demo_snapshot
from .hands import LIMIT, PLACE, TIPS, dual_arm, postures, with_forces

CHROMIUM = "/usr/bin/chromium"
ARGS = [
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # without it the picture may be blank, with exit code 0
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
POSITION = "viewer.scene_tree.find(['wbc', 'object']).object.position.toArray()"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def chromium():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs the playwright client")
    if not os.access(CHROMIUM, os.X_OK):
        pytest.skip(f"needs Debian's chromium at {CHROMIUM}")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGS)
        yield browser
        browser.close()


@pytest.fixture
def page(chromium):
    """A page that knows what it asked for and what went wrong in it."""
    opened = chromium.new_page(viewport={"width": 1000, "height": 640})
    opened.requested, opened.faults = [], []
    opened.on("request", lambda r: opened.requested.append(r.url))
    opened.on("websocket", lambda s: opened.requested.append(s.url))
    opened.on("pageerror", lambda e: opened.faults.append(str(e)))
    opened.on("console", lambda m: m.type == "error" and opened.faults.append(m.text))
    yield opened
    opened.close()


@pytest.fixture
def live():
    """A view of a run that goes on in a thread, at a thousand snapshots per second."""
    with LiveView(demo_scene()) as view:
        over = threading.Event()
        start = time.monotonic()

        def run() -> None:
            while not over.wait(0.001):
                view.publish(demo_snapshot(time.monotonic() - start))

        thread = threading.Thread(target=run)
        thread.start()
        yield view
        over.set()
        thread.join()


def picture(page) -> np.ndarray:
    """The pixels, (height, width, 3) in 0..1."""
    return matplotlib.image.imread(io.BytesIO(page.screenshot()), format="png")[:, :, :3]


def near(pixels: np.ndarray, color: tuple[float, ...], tolerance: float = 0.12) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels - np.array(color)).max(axis=2) < tolerance).sum())


def assert_drawn(page) -> None:
    pixels = picture(page)
    assert near(pixels, (0.94, 0.67, 0.24)) > 2000, "the object is not in the picture"
    assert near(pixels, (0.35, 0.44, 0.60)) > 500, "the palms are not in the picture"
    assert near(pixels, (0.16, 0.68, 0.35)) > 100, "no contact is green"


def test_the_live_page_follows_the_run(page, live):
    page.goto(live.url)
    page.wait_for_function("viewer.num_messages_received > 60")
    assert live.browsers == 1
    seen = []
    for _ in range(6):
        seen.append(page.evaluate(POSITION)[1])
        page.wait_for_timeout(250)
    assert len(set(seen)) == 6, f"the object stands still: {seen}"
    assert max(abs(y) for y in seen) <= 0.2 + 1e-6
    assert_drawn(page)
    assert float(page.inner_text("#wbc-panel .value").split()[0]) > 0.0
    assert page.locator("#wbc-panel .task:not(.out)").count() >= 2
    assert page.locator("#wbc-panel .phase.now").count() == 1
    hosts = {url.split("/")[2] for url in page.requested if not url.startswith("data:")}
    assert hosts == {live.url.split("/")[2]}
    assert page.faults == []


def test_the_scene_holds_what_was_published(page):
    with LiveView(demo_scene()) as view:
        page.goto(view.url)
        assert view.wait_for_browser(20.0)
        shot = demo_snapshot(1.3)
        view.publish(shot)
        page.wait_for_function(f"Math.abs({POSITION}[1] - {shot.object_pose[1]}) < 1e-6")
        turn = "viewer.scene_tree.find(['wbc', 'object']).object.quaternion.toArray()"
        np.testing.assert_allclose(page.evaluate(turn), shot.object_pose[3:], atol=1e-6)
        for i, body in enumerate(("left", "right")):
            place = f"viewer.scene_tree.find(['wbc', 'robot', '{body}']).object.position.toArray()"
            np.testing.assert_allclose(page.evaluate(place), shot.bodies[i, :3], atol=1e-6)
        arrow = "viewer.scene_tree.find(['wbc', 'contacts', 'f1', 'normal']).object"
        direction = (
            f"new MeshCat.THREE.Vector3(0, 0, 1).applyQuaternion({arrow}.quaternion).toArray()"
        )
        np.testing.assert_allclose(page.evaluate(direction), shot.contact_normals[0], atol=1e-6)


def test_a_page_survives_its_viewer(page):
    scene = demo_scene()
    with LiveView(scene, port=7450) as view:
        port = view.url
        page.goto(view.url)
        assert view.wait_for_browser(20.0)
        view.publish(demo_snapshot(0.5))
        page.wait_for_function(f"{POSITION}[1] > 0.05")
    page.wait_for_function("document.querySelector('#wbc-panel .lost').textContent !== ''")
    with LiveView(scene, port=7450) as again:
        if again.url != port:
            pytest.skip("another program took the port")
        assert again.wait_for_browser(20.0)
        again.publish(demo_snapshot(-0.5))
        page.wait_for_function(f"{POSITION}[1] < -0.05")
        page.wait_for_function("document.querySelector('#wbc-panel .lost').textContent === ''")


@pytest.mark.parametrize("planar", [True, False])
def test_the_exported_file_plays_by_itself(page, tmp_path, planar):
    run = [demo_snapshot(0.002 * k) for k in range(1501)]
    path = write_html(tmp_path / "run.html", demo_scene(planar), run)
    page.goto(path.as_uri())
    page.wait_for_function("viewer.animator.playing && viewer.animator.time > 0.1")
    seen = []
    for _ in range(4):
        seen.append(page.evaluate(POSITION)[1])
        page.wait_for_timeout(200)
    assert len(set(seen)) == 4, f"the object stands still: {seen}"
    assert_drawn(page)
    assert page.requested == [path.as_uri()], "the file asked for something else"
    assert page.faults == []


def test_the_exported_file_can_be_stopped_and_sought(page, tmp_path):
    run = [demo_snapshot(0.002 * k) for k in range(1501)]
    page.goto(write_html(tmp_path / "run.html", demo_scene(), run).as_uri())
    page.wait_for_function("viewer.animator.time > 0.1")
    page.click("#wbc-player button")
    page.locator("#wbc-player input").fill("2")
    page.wait_for_function(f"Math.abs({POSITION}[1] - {0.2 * np.sin(2.0)}) < 1e-3")
    page.wait_for_function("document.querySelector('#wbc-panel .value').textContent === '2.00 s'")
    assert page.locator("#wbc-panel .phase.now").inner_text() == "leave"
    color = (
        "viewer.scene_tree.find(['wbc','contacts','f2','point','<object>']).object.material.color"
    )
    assert page.evaluate(f"{color}.b") < 0.75, "at 2 s the second contact is free"
    page.locator("#wbc-player input").fill("1")
    page.wait_for_function(f"{color}.b > 0.85")


def test_a_robot_with_two_hands_is_where_its_kinematics_says(page, tmp_path):
    """Every body of the exported file at one time, its shapes, and the object's own mesh."""
    model, grasp, scene = dual_arm()
    rows = postures(model, 91)
    run = [SnapshotMaker(model).of_row(rows, k) for k in range(91)]
    path = write_html(tmp_path / "run.html", scene, run)
    assert path.read_bytes() == write_html(tmp_path / "again.html", scene, run).read_bytes()
    page.goto(path.as_uri())
    page.wait_for_function("viewer.animator.playing && viewer.animator.time > 0.1")
    page.click("#wbc-player button")
    page.locator("#wbc-player input").fill("1.5")
    page.wait_for_function("document.querySelector('#wbc-panel .value').textContent === '1.50 s'")
    page.wait_for_timeout(300)
    found = page.evaluate(
        """() => {
          const robot = viewer.scene_tree.find(['wbc', 'robot']);
          const out = {};
          for (const [name, node] of Object.entries(robot.children)) {
            node.object.updateMatrix();
            out[name] = [node.object.matrix.toArray(), Object.keys(node.children)];
          }
          return out;
        }"""
    )
    data = model.pin_model.createData()
    pin.forwardKinematics(model.pin_model, data, model.full(rows.q[45]))
    for body in model.full_names:
        shapes = sorted(s.name for s in scene.shapes if s.body == body)
        if not shapes and body not in found:
            continue
        matrix, children = found[body]
        pose = data.oMi[model.pin_model.getJointId(body)].homogeneous
        np.testing.assert_allclose(np.reshape(matrix, (4, 4)).T, pose, atol=1e-6, err_msg=body)
        assert [c for c in sorted(children) if c != "<object>"] == shapes
    drawn = page.evaluate(
        """() => {
          const mesh = viewer.scene_tree.find(['wbc', 'object', 'mesh', '<object>']).object;
          return Array.from(mesh.geometry.attributes.position.array);
        }"""
    )
    x, y, z = np.reshape(drawn, (-1, 3)).T
    assert (np.hypot(x, y).max(), np.ptp(z)) == pytest.approx((0.025, 0.3), abs=1e-4)
    assert page.locator("#wbc-panel .two .contact").count() == grasp.count
    assert page.locator("#wbc-panel .two .phase").count() == 10
    assert near(picture(page), (0.86, 0.87, 0.89), 0.1) > 5000, "the arms are not in the picture"
    assert page.requested == [path.as_uri()] and page.faults == []


ARROW = """() => {
  const node = viewer.scene_tree.find(['wbc', 'forces', '%s', 'force']);
  const { scale, visible, position } = node.object;
  const { material } = node.find(['<object>']).object;  // none before the geometry has come
  const red = material ? material.color.r : NaN;
  return [scale.z, red, visible, position.x, position.y, position.z];
}"""


def arrow(page, name: str) -> list:
    """Length [m], red of its colour, visible, position."""
    return page.evaluate(ARROW % name)


def test_force_arrows_grow_and_turn_orange_in_the_live_page(page):
    """The second finger presses more and more; from 2 s on a torque limit of it is active."""
    scene = replace(demo_scene(), friction_angles=(0.5, 0.5))

    def at(t: float):
        shot = demo_snapshot(t)
        push = -shot.contact_normals * np.array([[0.02], [0.02 + 0.01 * t]])
        wrench = np.array([0.0, 0.03, 0.0, 0.0, 0.0, 0.02])
        forces = ForceArrows(
            push, 0.5 * push, np.array([False, t >= 2.0]), shot.object_pose[:3], -wrench, wrench,
            shot.object_pose[:3],
        )  # fmt: skip
        return replace(shot, contact_mode=np.array([1, 1]), forces=forces)

    with LiveView(scene) as view:
        page.goto(view.url)
        assert view.wait_for_browser(20.0)
        seen = f"const [long, red, visible] = ({ARROW % 'f2'})()"
        for t, color in ((1.0, "red < 0.1"), (2.0, "red > 0.9")):  # green, then orange
            view.publish(at(t))
            long = f"Math.abs(long - {0.02 + 0.01 * t}) < 1e-6"
            page.wait_for_function(f"() => {{ {seen}; return visible && {long} && {color}; }}")
            place = arrow(page, "f2")[3:]
            np.testing.assert_allclose(place, at(t).contact_points[1], atol=1e-6)
            length, red, *_ = arrow(page, "f1")
            assert length == pytest.approx(0.02, abs=1e-6) and red < 0.1, "the other stays green"
        view.publish(replace(at(2.0), forces=None))
        page.wait_for_function(f"({ARROW % 'f2'})()[2] === false")
        hosts = {url.split("/")[2] for url in page.requested if not url.startswith("data:")}
        assert hosts == {view.url.split("/")[2]} and page.faults == []


def test_force_arrows_in_the_exported_file(page, tmp_path):
    """Two hands: at 1.2 s all arrows are green, at 2 s that of the right index finger is orange."""
    model, grasp, _ = dual_arm()
    rows = with_forces(model, postures(model, 91))
    q = rows.q
    tips = list(TIPS.values())
    scene = robot_scene(
        model, grasp, title="two hands", tips=tips, friction=[0.6] * 6,
        task_names=("object", "force", "moment", "posture"), phase_names=tuple("abcdefghij"),
        shown=[(q[0], PLACE), (q[-1], PLACE)],
    )  # fmt: skip
    scene = replace(scene, center=tuple(PLACE), extent=0.15)  # a look from near by
    maker = SnapshotMaker(
        model, arrows=ArrowMaker(model, tips, [-LIMIT] * model.nv, [LIMIT] * model.nv)
    )
    page.goto(
        write_html(
            tmp_path / "run.html", scene, [maker.of_row(rows, k) for k in range(91)]
        ).as_uri()
    )
    page.wait_for_function("viewer.animator.playing && viewer.animator.time > 0.1")
    page.click("#wbc-player button")
    for t in (0.5, 1.2, 2.0):
        page.locator("#wbc-player input").fill(str(t))
        page.wait_for_function(
            f"document.querySelector('#wbc-panel .value').textContent === '{t:.2f} s'"
        )
        page.wait_for_timeout(200)
        for name in TIPS:
            length, red, visible, *place = arrow(page, name)
            assert visible == (t >= 1.0)
            if visible:
                assert length == pytest.approx(0.10 / (0.4 * 9.81) * (1.0 + t), rel=1e-4)
                k = round(30 * t)
                np.testing.assert_allclose(
                    place, rows.contact_points[k, list(TIPS).index(name)], atol=1e-5
                )
                assert (red > 0.5) == (t >= 1.5 and name == "r_index")
    pixels = picture(page)
    assert near(pixels, (0.05, 0.60, 0.20)) > 20, "no arrow is green"
    assert page.faults == []

"""The pictures of synergies: what is drawn is what the tables and the hand say."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from wbc import resources
from wbc.arrays import Array
from wbc.cli import synergy_pictures
from wbc.cli.synergy_pictures import draw, is_published, look_of, range_weights
from wbc.errors import WbcError
from wbc.recording.figures import save, style
from wbc.recording.hand_sheet import HandLook, contact_sheet
from wbc.recording.synergy_plots import FINGER_COLORS, circular, finger_names, weights
from wbc.robot.hand import Hand
from wbc.robot.model import load_robot
from wbc.synergies import Synergies, tables, weights_of

PUBLISHED = Synergies.from_table()


@cache
def hand(name: str = "dexmart_hand_right", prefix: str = "") -> Hand:
    return Hand.of(load_robot(resources.find("urdf", name)), PUBLISHED.joints, prefix)


@cache
def look(name: str = "dexmart_hand_right", prefix: str = "") -> HandLook:
    return look_of(hand(name, prefix), PUBLISHED.joints)


def poses(*grasps: str, of: Hand | None = None) -> Array:
    alpha = np.array([weights_of(grasp) for grasp in grasps])
    return (of or hand()).poses(PUBLISHED.command(alpha))


def picture(grasp: str, view: str = "aslant", name: str = "dexmart_hand_right", prefix: str = ""):
    seen = look(name, prefix)
    own, eye = hand(name, prefix), getattr(seen, view)()
    corners = seen.frame(poses("C36", "C27", of=own), eye)
    return seen.image(poses(grasp, of=own)[0], eye, corners, 160)


def fitted(robot: str, count: int, scale: float = 1.0) -> Synergies:
    model = load_robot(resources.find("urdf", robot))
    random = np.random.default_rng(0).uniform(
        scale * model.lower, scale * model.upper, (9, 3, model.nv)
    )
    return Synergies.fit(random.reshape(-1, model.nv), model.joint_names, count=count)  # fmt: skip


def where(image: Array, color: str) -> Array:
    """Columns of the pixels whose hue is that of a colour."""
    rgb = np.array(to_rgb(color))
    flat, own = image - image.mean(axis=-1, keepdims=True), rgb - rgb.mean()
    length = np.linalg.norm(flat, axis=-1)
    near = (flat @ own > 0.97 * length * np.linalg.norm(own)) & (length > 0.1)
    return np.nonzero(near)[1]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return draw(PUBLISHED, "dexmart_hand_right", tmp_path_factory.mktemp("new") / "pictures")


def test_every_picture_is_there_and_not_blank(drawn: list[Path]) -> None:
    assert [path.name for path in drawn] == [
        "synergies_circular.png", "synergies_range.png", "synergies_weights.png", "grasps.png",
    ]  # fmt: skip
    for path in drawn:
        assert path.read_bytes().startswith(b"\x89PNG\r\n")
        pixels = matplotlib.image.imread(path)[..., :3]
        assert min(pixels.shape[:2]) > 500
        assert 0.02 < (pixels < 0.95).any(axis=-1).mean() < 0.6


def test_every_grasp_has_a_picture_of_its_own(drawn: list[Path]) -> None:
    pixels = matplotlib.image.imread(drawn[-1])[:-120, :, :3]  # without the legend
    thumb = np.unique(where(pixels, FINGER_COLORS[0]))
    starts = thumb[1:][np.diff(thumb) > 40]
    assert len(starts) == 8, "nine columns of hands, each with its thumb"
    one, other = picture("C27"), picture("C36")
    assert np.array_equal(one, picture("C27"))
    assert (np.abs(one - other).max(axis=-1) > 0.2).mean() > 0.05


def test_front_and_side_are_as_a_right_hand_looks() -> None:
    front, side = picture("C36", "front"), picture("C10", "side")
    thumb, little = where(front, FINGER_COLORS[0]), where(front, FINGER_COLORS[4])
    assert little.max() < thumb.min(), "fingers up and the palm to the eye: the thumb is right"
    palm = np.nonzero((side < 0.95).any(axis=-1)[-6:])[1].mean()
    assert where(side, FINGER_COLORS[1]).min() < palm - 10, "closed fingers are on the palm's side"


@pytest.mark.parametrize("view", ["front", "side", "aslant"])
def test_a_left_hand_on_an_arm_is_the_mirror_image(view: str) -> None:
    right = picture("C27", view)
    left = picture("C27", view, "dual_arm", "left_")
    cut = min(right.shape[1], left.shape[1])
    assert right.shape[0] == left.shape[0] and cut == 160
    solid = [(image < 0.97).any(axis=-1) for image in (right, left[:, ::-1])]
    assert (solid[0] != solid[1]).mean() < 0.005


def test_bars_are_as_long_as_the_synergies_say_and_inwards_where_negative() -> None:
    with style():
        figure = circular(PUBLISHED, hand().fingers)
    assert len(figure.axes) == 3
    for k, axes in enumerate(figure.axes):
        bars: Any = axes.containers[0]
        np.testing.assert_allclose([bar.get_height() for bar in bars], PUBLISHED.basis[:, k])
        assert [bool(bar.get_hatch()) for bar in bars] == (PUBLISHED.basis[:, k] < 0.0).tolist()
        assert [t.get_text() for t in axes.get_xticklabels()] == [str(j) for j in range(1, 16)]
        middles = [bar.get_x() + 0.5 * bar.get_width() for bar in bars]
        np.testing.assert_allclose(middles, 2.0 * np.pi * np.arange(15) / 15, atol=1e-12)
        low, high = axes.get_ylim()
        assert low <= PUBLISHED.basis.min() and PUBLISHED.basis.max() <= high
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[0] == "thumb (1-3)" and legend[4] == "little (13-15)"


def test_weights_are_where_table_2_and_5_have_them() -> None:
    t = tables()
    path = np.array([(0.0, 0.0, 0.0), (-130.0, 5.0, -8.0), (75.9, 19.8, -68.0)])
    with style():
        axes: Any = weights(t, path).axes[0]
    drawn = {c.get_label(): np.stack(c._offsets3d, axis=1) for c in axes.collections}
    marked = {m: t.weights[[x == m for x in t.marks]] for m in ("star", "diamond", "")}
    for label, expected in (
        ("grasped with two synergies", marked["star"]),
        ("grasped thanks to the third", marked["diamond"]),
        ("others of the reference set", marked[""]),
        ("new objects, G1 to G5", t.new_weights),
    ):
        np.testing.assert_allclose(drawn[label], expected)
    (dashed,) = (x for x in axes.lines if str(x.get_label()).startswith("a reach"))
    np.testing.assert_allclose(np.stack(dashed.get_data_3d(), axis=1), path)
    assert {"C27", "G3", "C16"} <= {text.get_text() for text in axes.texts}


def test_the_reach_opens_the_hand_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[Array] = []

    def stub(*values: Any) -> Figure:
        asked.append(values[-1])
        return Figure()

    for name in ("weights", "circular", "_range_figure", "_grasp_figure"):
        monkeypatch.setattr(synergy_pictures, name, stub if name == "weights" else empty)
    draw(PUBLISHED, "dexmart_hand_right", tmp_path)
    (path,) = asked
    assert (path[0] == 0.0).all() and path[2].tolist() == pytest.approx([75.9, 19.8, -68.0])
    opened = np.rad2deg(PUBLISHED.posture(np.deg2rad(path[1])))
    assert np.abs(opened).max() < 15.0, "as straight as three synergies can"


def empty(*_: Any) -> Figure:
    return Figure()


def test_clipped_grasps_are_marked_with_joint_and_excess(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(synergy_pictures, "contact_sheet", lambda *values: asked.extend(values))
    synergy_pictures._grasp_figure(PUBLISHED, hand(), look())
    names, notes = [name.partition("\n")[0] for name in asked[1]], asked[2]
    assert len(names) == 41 and sum(map(bool, notes)) == 17
    assert notes[names.index("C34")] == ["thumb med −23.3°", "little med −0.3°"]
    assert notes[names.index("C1")] == []
    with style():
        figure = contact_sheet(
            look(), asked[1][:4], [[], ["thumb abd +1.0°"], [], []], asked[3][:4]
        )
    texts = [text.get_text() for text in figure.texts]
    assert texts.count("▼") == 1 and "thumb abd +1.0°" in texts and "C4" in texts


def test_range_weights_are_those_within_the_ranges() -> None:
    ends = range_weights(PUBLISHED, hand())
    np.testing.assert_allclose(ends[:, [0, 2]], PUBLISHED.ranges())
    assert (ends[:, 1] == 0.0).all()
    # the robot's limits where the synergies know none: wider by 5 to 30 degrees
    unknown = np.full(15, np.inf)
    own = range_weights(replace(PUBLISHED, lower=-unknown, upper=unknown), hand())
    assert (own[:, 0] < ends[:, 0]).all() and (own[:, 2] > ends[:, 2]).all()
    assert np.isfinite(own).all()
    # two standard deviations where the zero offset itself is out of range
    beyond = replace(PUBLISHED, mean=PUBLISHED.mean + 2.0)
    np.testing.assert_allclose(
        range_weights(beyond, hand())[:, 2], 2.0 * np.sqrt(PUBLISHED.variances)
    )


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    some = fitted("dexmart_hand_left", 1, 0.2)
    files = [draw(some, "dexmart_hand_left", tmp_path / folder) for folder in "ab"]
    grasps = poses("C27", "C36", "C10")
    for folder, paths in zip("ab", files, strict=True):
        with style():
            sheet = contact_sheet(look(), ("C27", "C36", "C10"), [["a"], [], []], grasps)
            paths.append(save(sheet, tmp_path / folder / "sheet.png"))
            points = weights(tables(), np.deg2rad([weights_of("C1"), weights_of("C27")]))
            paths.append(save(points, tmp_path / folder / "weights.png"))
    for one, other in zip(*files, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


@pytest.mark.parametrize(("robot", "count"), [("planar_gripper", 4), ("dexmart_hand_left", 1)])
def test_other_hands_and_numbers_of_synergies(robot: str, count: int, tmp_path: Path) -> None:
    files = draw(fitted(robot, count), robot, tmp_path)
    assert [path.name for path in files] == ["synergies_circular.png", "synergies_range.png"]
    for path in files:
        assert (matplotlib.image.imread(path)[..., :3] < 0.9).any(axis=-1).mean() > 0.005


def test_only_the_published_synergies_have_the_published_grasps() -> None:
    assert is_published(Synergies.from_table())
    assert not is_published(replace(PUBLISHED, mean=PUBLISHED.mean + 1e-3))
    assert not is_published(
        replace(PUBLISHED, basis=PUBLISHED.basis[:, :2], variances=PUBLISHED.variances[:2])
    )


def test_fingers_are_named_by_their_joints() -> None:
    assert finger_names(PUBLISHED.joints, hand().fingers) == (
        "thumb", "index", "middle", "ring", "little",
    )  # fmt: skip
    assert finger_names(("joint_0", "joint_1"), (0, 1)) == ("finger 1", "finger 2")
    assert finger_names(("ff_1", "ff_2", "th_1"), (0, 0, 1)) == ("ff", "th")


def test_faults_are_one_line(tmp_path: Path) -> None:
    for robot, prefix, said in (
        ("dexmart_hand_right", "right_", "no joint 'right_thumb_abd' and 14 more"),
        ("gantry", "", "no joint 'thumb_abd'"),
        ("no_such_hand", "", "unknown robot 'no_such_hand'"),
    ):
        with pytest.raises(WbcError, match=said) as caught:
            draw(PUBLISHED, robot, tmp_path / "out", prefix)
        assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(WbcError):
        draw(PUBLISHED, "dexmart_hand_right", tmp_path / "file")

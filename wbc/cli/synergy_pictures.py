"""The pictures of a hand's synergies: Figures 21, 22 and 26 of the chapter, and all grasps."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from wbc.arrays import Array
from wbc.cli.synergy_files import synergies_of, within_limits
from wbc.recording.figures import save, style
from wbc.recording.hand_sheet import HandLook, contact_sheet, synergy_ranges
from wbc.recording.synergy_plots import circular, finger_names, weights
from wbc.robot.hand import Hand
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot
from wbc.synergies import Reach, Synergies, tables, weights_of
from wbc.view.from_robot import robot_shapes

CIRCULAR, RANGE = "synergies_circular.png", "synergies_range.png"
WEIGHTS, GRASPS = "synergies_weights.png", "grasps.png"
"""Files of the pictures; the last two are of the published synergies only."""

_REACH = "C27"
_OBJECTS = {
    "C10": "box", "C16": "credit card", "C19": "pen", "C27": "pen, side", "G1": "power palm",
    "G2": "power pad", "G3": "side", "G4": "precision pad", "G5": "precision side",
}  # fmt: skip


def pictures_command(arguments: argparse.Namespace) -> int:
    """Draw them."""
    out = Path(arguments.out)
    files = draw(synergies_of(arguments), arguments.hand, out, arguments.prefix)
    print(f"written to {out}: {', '.join(file.name for file in files)}")
    return 0


def draw(synergies: Synergies, hand: Path | str, out: Path, prefix: str = "") -> list[Path]:
    """Draw the pictures of synergies on a hand; the same input gives the same bytes.

    Args:
        hand: a robot's file, or the name of one that travels with wbc; its joints carry the
            synergies' names.
        out: folder, made if it is missing.
        prefix: of the joints' names in the robot, e.g. ``right_``.

    Returns:
        The files: `CIRCULAR` and `RANGE`, and for the published synergies `WEIGHTS` and `GRASPS`.

    Raises:
        WbcError: the robot is not found or faulty, it lacks a joint, or a file cannot be written.
    """
    model = read_robot(robot_file(str(hand), Path()))
    found = Hand.of(model, synergies.joints, prefix)
    look = look_of(found, synergies.joints)
    files = []
    with style():
        files.append(save(circular(synergies, found.fingers), out / CIRCULAR))
        ends = range_weights(synergies, found)
        files.append(save(_range_figure(synergies, found, look, ends), out / RANGE))
        if is_published(synergies):
            path = np.rad2deg(Reach.to(synergies, weights_of(_REACH)).corners)
            files.append(save(weights(tables(), path), out / WEIGHTS))
            files.append(save(_grasp_figure(synergies, found, look), out / GRASPS))
    return files


def look_of(hand: Hand, joints: tuple[str, ...]) -> HandLook:
    """The visual shapes of the hand's links, seen from its palm."""
    model, fingers = hand.model, hand.body_fingers()
    # Pinocchio names a shape after its link
    shapes = tuple(s for s in robot_shapes(model) if s.name.rpartition("_")[0] in hand.links)
    names = finger_names(joints, hand.fingers)
    bodies = {name: k + 1 for k, name in enumerate(model.full_names)}
    return HandLook(shapes, bodies, fingers, names, _thumb_side(hand, names))


def _thumb_side(hand: Hand, names: tuple[str, ...]) -> float:
    """Where the thumb begins, on the palm's +y side (+1) or not (-1); +1 without a thumb."""
    thumbs = [k for k, name in enumerate(names) if "thumb" in name.lower()]
    if not thumbs:
        return 1.0
    place = hand.joints[hand.fingers.index(thumbs[0])]
    root = 1 + int(hand.model.own[place])
    middle = 0.5 * (hand.model.lower + hand.model.upper)[hand.joints]
    return 1.0 if hand.poses(middle[None])[0, root, 1, 3] >= 0.0 else -1.0


def range_weights(synergies: Synergies, hand: Hand) -> Array:
    """(k, 3) least weight of each synergy alone, 0 and the largest one, [rad].

    The ranges of the synergies' joints count, and those of the robot. Where they do not bound a
    weight, or do not hold c̄, two standard deviations (53) stand for the range.
    """
    ends = within_limits(synergies, hand).ranges()
    spread = 2.0 * np.sqrt(np.maximum(synergies.variances, 0.0))
    ends = np.where(np.isfinite(ends), ends, np.stack((-spread, spread), axis=1))
    out: Array = np.stack((ends[:, 0], np.zeros(len(ends)), ends[:, 1]), axis=1)
    return out


def is_published(synergies: Synergies) -> bool:
    """Whether these are the published ones, so that the published grasps are theirs."""
    own = Synergies.from_table()
    return synergies.joints == own.joints and all(
        np.array_equal(getattr(synergies, name), getattr(own, name)) for name in ("mean", "basis")
    )


def _range_figure(synergies: Synergies, hand: Hand, look: HandLook, ends: Array) -> Figure:
    count = synergies.count
    alone = np.eye(count)[:, None, :] * ends[..., None]  # (k, 3, k)
    poses = hand.poses(synergies.command(alone.reshape(-1, count)))
    return synergy_ranges(look, np.rad2deg(ends), poses.reshape(count, 3, *poses.shape[1:]))


def _grasp_figure(synergies: Synergies, hand: Hand, look: HandLook) -> Figure:
    t = tables()
    names = [f"{n}\n{_OBJECTS.get(n, '')}" for n in (*t.names, *t.new_names)]
    alpha = np.deg2rad(np.concatenate((t.weights, t.new_weights)))
    excess = np.rad2deg(synergies.excess(synergies.posture(alpha)))
    notes = [
        [
            f"{joint.replace('_', ' ')} {value:+.{1 if abs(value) >= 0.1 else 2}f}°".replace(
                "-", "−"
            )
            for joint, value in zip(synergies.joints, row, strict=True)
            if value != 0.0
        ]
        for row in excess
    ]
    return contact_sheet(look, names, notes, hand.poses(synergies.command(alpha)))

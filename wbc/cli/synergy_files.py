"""``wbc synergy project, fit, import``: from postures to weights, and from files to synergies."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from wbc.arrays import Array
from wbc.errors import WbcError
from wbc.robot.hand import Hand
from wbc.robot.self_distances import SelfDistance
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot
from wbc.synergies import Postures, Synergies, read_eigengrasps, read_postures

NOTICED = np.deg2rad(0.05)
"""A joint clipped by less is not told, [rad]."""


def project_command(arguments: argparse.Namespace) -> int:
    """Print the weights of each posture (56), its average error, and what is clipped."""
    synergies = synergies_of(arguments)
    postures = postures_of(arguments.postures, arguments.unit, synergies)
    weights = synergies.project(postures.values)
    back = synergies.posture(weights)
    width = max(len(name) for name in (*postures.names, "posture"))
    heads = "".join(f"{f'alpha_{j + 1}':>9}" for j in range(synergies.count))
    print(f"weights and errors in deg; e is the error's length over {len(synergies.joints)} joints")
    print(f"{'posture':{width}}{heads}{'e':>9}  farthest joint")
    for name, alpha, given, reached in zip(
        postures.names, weights, postures.values, back, strict=True
    ):
        error = np.rad2deg(given - reached)
        print(
            f"{name:{width}}"
            + "".join(f"{value:9.2f}" for value in np.rad2deg(alpha))
            + f"{np.linalg.norm(error) / len(error):9.2f}  {farthest(synergies, given, reached)}"
        )
        for line in _clipped(synergies, reached):
            print(f"{'':{width}}  {line}")
    return 0


def fit_command(arguments: argparse.Namespace) -> int:
    """Find synergies (52) and save them."""
    postures = read_postures(arguments.postures, unit=arguments.unit)
    lower, upper = _ranges(arguments, postures.joints)
    if lower is not None:  # known only now: values that the hand cannot have are refused
        postures = read_postures(
            arguments.postures, postures.joints, unit=arguments.unit, lower=lower, upper=upper
        )
    try:
        synergies = Synergies.fit(
            postures.values, postures.joints, count=arguments.count, lower=lower, upper=upper
        )
    except WbcError as error:
        raise WbcError(f"{arguments.postures}: {error}") from None
    synergies.save(arguments.out)
    _say_saved(synergies, f"{len(postures.names)} postures of", arguments.out)
    return 0


def import_command(arguments: argparse.Namespace) -> int:
    """Read a GraspIt! file and save it."""
    joints = tuple(name.strip() for name in arguments.joints.split(","))
    lower, upper = _ranges(arguments, joints)
    synergies = read_eigengrasps(arguments.file, joints, lower=lower, upper=upper)
    synergies.save(arguments.out)
    _say_saved(synergies, "eigengrasps of", arguments.out)
    return 0


def synergies_of(arguments: argparse.Namespace) -> Synergies:
    """Those of ``--synergies``, or the published ones."""
    if arguments.synergies is None:
        return Synergies.from_table()
    return Synergies.load(arguments.synergies)


def hand_of(arguments: argparse.Namespace, joints: tuple[str, ...]) -> Hand:
    """The hand of ``--hand`` and ``--prefix``."""
    model = read_robot(robot_file(arguments.hand, Path()))
    names = model.joint_names
    if not any(arguments.prefix + joint in names for joint in joints):
        ends = {n.removesuffix(joints[0]) for n in names if n.endswith(joints[0])}
        remedy = f"--prefix {' or '.join(sorted(ends))}" if ends else "another --hand"
        raise WbcError(f"{model.path}: no joint '{arguments.prefix + joints[0]}' nor any other of "
                       f"the synergies' (give {remedy})")  # fmt: skip
    return Hand.of(model, joints, arguments.prefix)


def within_limits(synergies: Synergies, hand: Hand) -> Synergies:
    """The same synergies, their ranges cut to the limits of the robot that is to take them."""
    least, most = hand.model.lower[hand.joints], hand.model.upper[hand.joints]
    return replace(
        synergies,
        lower=np.clip(synergies.lower, least, most),
        upper=np.clip(synergies.upper, least, most),
    )


def _ranges(
    arguments: argparse.Namespace, joints: tuple[str, ...]
) -> tuple[Array | None, Array | None]:
    """The ranges of a hand's joints, [rad], where its robot is given."""
    if arguments.hand is None:
        return None, None
    hand = hand_of(arguments, joints)
    return hand.model.lower[hand.joints], hand.model.upper[hand.joints]


def postures_of(path: str, unit: str | None, synergies: Synergies) -> Postures:
    """The postures of a file, of the joints of `synergies`."""
    return read_postures(
        path, synergies.joints, unit=unit, lower=synergies.lower, upper=synergies.upper
    )


def _clipped(synergies: Synergies, posture: Array) -> list[str]:
    excess = synergies.excess(posture)
    return [
        f"{joint} is {np.rad2deg(abs(excess[j])):.1f} deg {beyond(excess[j])}: clipped"
        for j, joint in enumerate(synergies.joints)
        if abs(excess[j]) > NOTICED
    ]


def beyond(excess: float) -> str:
    """On which side of its range a joint is."""
    return "above its range" if excess > 0.0 else "below its range"


def farthest(synergies: Synergies, given: Array, reached: Array) -> str:
    """The joint (n,) of a posture [rad] that is reached worst, and by how much it misses."""
    error = np.rad2deg(given - reached)
    worst = int(np.abs(error).argmax())
    return f"{synergies.joints[worst]} {error[worst]:+.1f}" if abs(error[worst]) > 0.05 else "-"


def _say_saved(synergies: Synergies, what: str, out: str) -> None:
    share = ", ".join(f"{100 * value:.1f}" for value in synergies.explained)
    print(f"{what} {len(synergies.joints)} joints: {synergies.count} synergies explain {share} %")
    print(f"written to {out}")


def near_text(near: SelfDistance) -> str:
    """How near a hand comes to itself, in a line."""
    if near.distance <= 0.0:
        return f"{near.first} and {near.second} overlap by {-1e3 * near.distance:.1f} mm"
    return f"{near.first} and {near.second} come as near as {1e3 * near.distance:.1f} mm"

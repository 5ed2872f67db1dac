"""``wbc synergy grasp, show``: a hand moved along its synergies, by the stack as in any run."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from wbc.arrays import Array
from wbc.cli.run import run_command
from wbc.cli.synergy_arguments import DEFAULT_HAND
from wbc.cli.synergy_files import NOTICED, hand_of, near_text, postures_of, synergies_of
from wbc.cli.synergy_pictures import range_weights
from wbc.errors import WbcError, did_you_mean
from wbc.robot.hand import Hand
from wbc.robot.self_distances import self_distances
from wbc.scenario.places import robot_file
from wbc.synergies import Reach, Synergies, weights_of

_REACH = "synergy_reach"


def grasp_command(arguments: argparse.Namespace) -> int:
    """Tell a grasp and where the way to it is clipped, then run the reach."""
    synergies = synergies_of(arguments)
    name, weights = _grasp(arguments, synergies)
    hand = hand_of(arguments, synergies.joints)
    reach = Reach.to(synergies, weights, law=arguments.path)
    print(f"{name}: weights {_degrees(weights)} deg")
    for joint, start, end, excess in reach.beyond():
        if abs(excess) > NOTICED:
            where = "above" if excess > 0.0 else "below"
            print(f"  {joint} would go {abs(np.rad2deg(excess)):.1f} deg {where} its range, "
                  f"{start:.2f} to {end:.2f} s: clipped")  # fmt: skip
    (near,) = self_distances(hand, synergies.command(weights)[None])
    print(f"  {near_text(near)}")
    settings = [
        f"phases.open.weights.shape={_list(reach.corners[1])}",
        f"phases.close.weights.shape={_list(weights)}",
        f"tasks.shape.path={reach.law}",
    ]
    return _run(arguments, synergies, hand, name, settings)


def show_command(arguments: argparse.Namespace) -> int:
    """Tell what a synergy does to each joint, then move the hand along it."""
    synergies = synergies_of(arguments)
    number = _number(arguments.synergy, synergies)
    hand = hand_of(arguments, synergies.joints)
    ends = range_weights(synergies, hand)[number]
    along = np.outer(ends, np.eye(synergies.count)[number])
    shown = np.rad2deg(synergies.command(along))
    print(f"{arguments.synergy} alone: weight {ends[0]:.4g} to {ends[2]:.4g} rad "
          f"({_degrees(ends[[0, 2]])} deg)")  # fmt: skip
    print(f"{'joint [deg]':16}{'least':>9}{'offset':>9}{'largest':>9}{'per unit':>10}")
    for joint, values, unit in zip(
        synergies.joints, shown.T, synergies.basis[:, number], strict=True
    ):
        print(f"{joint:16}" + "".join(f"{value:9.1f}" for value in values) + f"{unit:10.3f}")
    parts = (("least", along[0], 3), ("largest", along[2], 6), ("offset", along[1], 3))
    phases = ", ".join(
        f"{{name: {name}, tasks: [shape], weights: {{shape: {_list(alpha)}}}, over: {over} s, "
        f"until: {{time: {over} s}}, timeout: {{after: {over + 1} s, then: stop}}}}"
        for name, alpha, over in parts
    )
    settings = [f"phases=[{phases}]", "tasks.shape.path=smooth", "simulation.duration=13 s"]
    return _run(arguments, synergies, hand, arguments.synergy, settings)


def _grasp(arguments: argparse.Namespace, synergies: Synergies) -> tuple[str, Array]:
    """A grasp's name and its weights (k,), [rad]."""
    asked: str = arguments.grasp
    path, _, row = asked.rpartition(":") if ".csv:" in asked else (asked, "", "")
    if path.endswith(".csv"):
        postures = postures_of(path, arguments.unit, synergies)
        if not row and len(postures.names) > 1:
            known = ", ".join(postures.names[:6])
            raise WbcError(f"{path}: {len(postures.names)} postures; choose one, e.g. "
                           f"{path}:{postures.names[0]} (known: {known})")  # fmt: skip
        name = row or postures.names[0]
        if name not in postures.names:
            raise WbcError(f"{path}: no posture '{name}'{did_you_mean(name, postures.names)}")
        return name, synergies.project(postures.values[postures.names.index(name)])
    if asked == "open":
        return asked, synergies.project(np.zeros(len(synergies.joints)))
    if arguments.synergies is not None:
        raise WbcError(f"grasp '{asked}': only the published synergies have named grasps "
                       "(give a POSTURE.csv, or open)")  # fmt: skip
    return asked, weights_of(asked)


def _number(name: str, synergies: Synergies) -> int:
    known = [f"e{j + 1}" for j in range(synergies.count)]
    if name not in known:
        raise WbcError(f"unknown synergy '{name}'{did_you_mean(name, known)}")
    return known.index(name)


def _run(
    arguments: argparse.Namespace,
    synergies: Synergies,
    hand: Hand,
    name: str,
    settings: list[str],
) -> int:
    """Run the reach's scenario with other settings: the same stack, log and view as any other."""
    if arguments.synergies is not None:
        settings.append(f"tasks.shape.synergies={Path(arguments.synergies).resolve()}")
    if arguments.hand != DEFAULT_HAND:
        settings.append(f"robot.urdf={_place(arguments.hand)}")
    if arguments.prefix:
        settings.append(f"tasks.shape.prefix={arguments.prefix}")
    model, at = hand.model, hand.joints
    start = np.clip(synergies.command(np.zeros(synergies.count)), model.lower[at], model.upper[at])
    joints = ", ".join(
        f"{arguments.prefix}{joint}: {value!r} rad"
        for joint, value in zip(synergies.joints, start.tolist(), strict=True)
    )
    settings.append(f"robot.start={{{joints}}}")
    given: dict[str, Any] = {
        **vars(arguments), "scenario": _REACH, "settings": settings, "seed": None,
        "realtime": False, "fast": False, "out": arguments.out or f"runs/synergy_{name}",
    }  # fmt: skip
    return run_command(argparse.Namespace(**given))


def _place(robot: str) -> str:
    """A robot as a scenario in another folder names it."""
    if "://" in robot:
        return robot
    return str(robot_file(robot, Path()).resolve())


def _degrees(values: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in np.rad2deg(values))


def _list(weights: Array) -> str:
    return "[" + ", ".join(f"{value!r} rad" for value in weights.tolist()) + "]"

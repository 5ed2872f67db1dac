"""``wbc synergy grasp, show``: a hand moved along its synergies, by the stack as in any run."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from wbc.arrays import Array
from wbc.cli.run import run_command
from wbc.cli.synergy_arguments import DEFAULT_HAND
from wbc.cli.synergy_files import (
    NOTICED,
    beyond,
    farthest,
    hand_of,
    near_text,
    postures_of,
    synergies_of,
    within_limits,
)
from wbc.cli.synergy_pictures import range_weights
from wbc.errors import UnknownNameError, WbcError, did_you_mean
from wbc.robot.hand import Hand
from wbc.robot.self_distances import self_distances
from wbc.scenario.places import robot_file
from wbc.scenario.synergies import known_names, weights_named
from wbc.synergies import Reach, Synergies

_REACH = "synergy_reach"
_FILE = re.compile(r"(.*?\.csv)(?::(.*))?", re.IGNORECASE)
_LARGEST = 100.0  # of a weight that is typed, [rad]
_LONGEST = 60  # of what a folder is called after


def grasp_command(arguments: argparse.Namespace) -> int:
    """Tell a grasp and where the way to it is clipped, then run the reach."""
    hand, synergies = _hand(arguments)
    name, weights, shown = _grasp(arguments, synergies)
    reach = Reach.to(synergies, weights, law=arguments.path)
    print(f"{name}: weights {_degrees(weights)} deg")
    for joint, start, end, excess in reach.beyond():
        if abs(excess) > NOTICED:
            print(f"  {joint} would go {abs(np.rad2deg(excess)):.1f} deg {beyond(excess)}, "
                  f"{start:.2f} to {end:.2f} s: clipped")  # fmt: skip
    if shown is not None:
        missed = farthest(synergies, shown, synergies.command(weights))
        print(f"  farthest from what was shown: {missed} deg")
    (near,) = self_distances(hand, synergies.command(weights)[None])
    print(f"  {near_text(near)}")
    settings = [
        f"phases.open.weights.shape={_list(reach.corners[1])}",
        f"phases.close.weights.shape={_list(weights)}",
        f"tasks.shape.path={reach.law}",
    ]
    return _run(arguments, synergies, name, settings)


def show_command(arguments: argparse.Namespace) -> int:
    """Tell what a synergy does to each joint, then move the hand along it."""
    hand, synergies = _hand(arguments)
    number = _number(arguments.synergy, synergies)
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
    return _run(arguments, synergies, arguments.synergy, settings)


def _hand(arguments: argparse.Namespace) -> tuple[Hand, Synergies]:
    """The hand, and its synergies with the ranges that hand and synergies share."""
    synergies = synergies_of(arguments)
    hand = hand_of(arguments, synergies.joints)
    return hand, within_limits(synergies, hand)


def _grasp(arguments: argparse.Namespace, synergies: Synergies) -> tuple[str, Array, Array | None]:
    """A grasp's name, its weights (k,) and the posture (n,) that was shown, if one was, [rad]."""
    asked: str = arguments.grasp
    if (file := _FILE.fullmatch(asked)) is not None:
        path, row = file.groups()
        postures = postures_of(path, arguments.unit, synergies)
        if not row and len(postures.names) > 1:
            known = ", ".join(postures.names[:6])
            raise WbcError(f"{path}: {len(postures.names)} postures; choose one, e.g. "
                           f"{path}:{postures.names[0]} (known: {known})")  # fmt: skip
        name = row or postures.names[0]
        if name not in postures.names:
            raise WbcError(f"{path}: no posture '{name}'{did_you_mean(name, postures.names)}")
        shown = postures.values[postures.names.index(name)]
        return name, synergies.project(shown), shown
    if "," in asked:
        return "weights", _typed(asked, synergies), None
    published = arguments.synergies is None
    names = known_names(published=published)
    if asked not in names:
        raise UnknownNameError("grasp", asked, ("POSTURE.csv", *names))
    return asked, weights_named(asked, synergies, published=published), None


def _typed(text: str, synergies: Synergies) -> Array:
    """Weights (k,) as ``wbc synergy project`` prints them, in degrees; [rad]."""
    try:
        weights = np.deg2rad([float(part) for part in text.removesuffix("deg").split(",")])
    except ValueError:
        raise WbcError(f"'{text}' are no weights: write numbers in deg, as 75.9,19.8,-68") from None
    if len(weights) != synergies.count or not (np.abs(weights) <= _LARGEST).all():
        raise WbcError(f"'{text}': {synergies.count} weights are needed, in deg")
    return weights


def _number(name: str, synergies: Synergies) -> int:
    known = [f"e{j + 1}" for j in range(synergies.count)]
    if name not in known:
        raise WbcError(f"unknown synergy '{name}'{did_you_mean(name, known)}")
    return known.index(name)


def _run(
    arguments: argparse.Namespace,
    synergies: Synergies,
    name: str,
    settings: list[str],
) -> int:
    """Run the reach's scenario with other settings: the same stack, log and view as any other."""
    if arguments.synergies is not None:
        settings.append(f"tasks.shape.synergies={_text(Path(arguments.synergies).resolve())}")
    if arguments.hand != DEFAULT_HAND:
        settings.append(f"robot.urdf={_text(_place(arguments.hand))}")
    if arguments.prefix:
        settings.append(f"tasks.shape.prefix={_text(arguments.prefix)}")
    start = synergies.command(np.zeros(synergies.count))
    joints = ", ".join(
        f"{_text(arguments.prefix + joint)}: {value!r} rad"
        for joint, value in zip(synergies.joints, start.tolist(), strict=True)
    )
    settings.append(f"robot.start={{{joints}}}")
    plain = re.sub(r"[^\w.-]+", "_", name)[:_LONGEST]  # a row's name may hold slashes
    given: dict[str, Any] = {
        **vars(arguments), "scenario": _REACH, "settings": settings, "seed": None,
        "realtime": False, "fast": False, "out": arguments.out or f"runs/synergy_{plain}",
    }  # fmt: skip
    return run_command(argparse.Namespace(**given))


def _place(robot: str) -> str:
    """A robot as a scenario in another folder names it."""
    if "://" in robot:
        return robot
    return str(robot_file(robot, Path()).resolve())


def _text(value: object) -> str:
    """As YAML reads it back, whatever is in it."""
    return json.dumps(str(value), ensure_ascii=False)


def _degrees(values: Array) -> str:
    return ", ".join(f"{value:.4g}" for value in np.rad2deg(values))


def _list(weights: Array) -> str:
    return "[" + ", ".join(f"{value!r} rad" for value in weights.tolist()) + "]"

"""How the tick of the bottle's exchange grows with the fingers in contact and the watched pairs.

    python -m benchmarks.tick dual_arm_exchange --growth

Contacts: the robot is given all ten fingers and stands as it does where both hands share the
object; 0, 3, 6 and 10 fingers hold it, those of the right hand pivoting, of the left one sliding.
Fingers that the exchange does not use touch nothing there: each is given the contact point nearest
to it, and a pad as long as the way to it, so that all agree where the object is.
Pairs: those of the scenario, thinned evenly, in the same situation of the exchange itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.tick import EULER, FLOOR, KINEMATICS, RUNGE_KUTTA, ratio, ticks, timed
from wbc.contact.grasp import ContactMode
from wbc.control.references import Motion
from wbc.control.state import ControllerState, PhaseState
from wbc.robot.collision_scene import OBJECT
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.stack.activation import Activation

Both = tuple[Assembly, Assembly]

_PHASE = "slide"  # in which both hands hold
_SETTLED = 0.2  # into it, [s]
_WARM = 100  # ticks in which a situation made up here comes to its ordinary motion
_BLOCKS = 9
_PAIRS = (200, 500, 1000, 1500)
_SIDES = {"r": "right", "l": "left"}
_THREE = ("thumb", "index", "middle")
_NAMES = [f"{side}_{finger}" for side in _SIDES for finger in (*_THREE, "ring", "little")]
_CONTACTS = (
    [],
    [f"r_{finger}" for finger in _THREE],
    [f"{side}_{finger}" for side in _SIDES for finger in _THREE],
    _NAMES,
)


def both(scenario: str, overrides: Mapping[str, Any]) -> Both:
    """The scenario by Euler's rule and by the Runge-Kutta rule."""
    euler, rk4 = (
        build(load(scenario, {**overrides, "simulation.integrator": rule}))
        for rule in ("euler", "rk4")
    )
    return euler, rk4


def shared(assembly: Assembly) -> ControllerState:
    """The state in which both hands hold."""
    controller, state = assembly.controller, assembly.start
    names = [phase.name for phase in controller.phases.phases]
    for _ in range(assembly.ticks):
        record, state = controller.step(state)
        if names[record.phase] == _PHASE and record.t > state.phase.since + _SETTLED:
            return state
    raise SystemExit(f"the scenario does not come to a phase '{_PHASE}'")


def row(title: str, assemblies: Both, state: ControllerState) -> None:
    """Time one state and print it."""
    parts = ticks(*assemblies, state)
    blocks = [{name: timed(part) for name, part in parts.items()} for _ in range(_BLOCKS)]
    euler, rk4 = ratio(blocks, EULER, FLOOR), ratio(blocks, RUNGE_KUTTA, FLOOR)
    kinematics, floor = ratio(blocks, EULER, KINEMATICS), ratio(blocks, FLOOR, KINEMATICS)
    print(f"| {title} | {floor:.1f} | {kinematics:.1f} | {euler:.2f} | {rk4:.2f} |", flush=True)


def head(what: str) -> None:
    """The title row of a table."""
    print(f"\n| {what} | floor x kinematics | Euler x kinematics | Euler x floor | RK4 x floor |")
    print("|---|---|---|---|---|")


def ten_fingers(scenario: str) -> Both:
    """The scenario with all fingers of both hands, those added pressing next to nothing.

    The object is long enough for all of them, and so would pass through the palms: its own pairs
    are left out.
    """
    loaded = load(scenario)
    watched = build(loaded).controller.law.distances.scene.pair_names
    added: dict[str, Any] = {
        "object.surface.length": "600 mm",
        "robot.collisions.pairs": sorted({pair for pair in watched if OBJECT not in pair}),
    }
    for name in (n for n in _NAMES if n not in loaded.scenario.contacts):
        side, finger = name.split("_")
        added[f"robot.fingers.{name}"] = f"{_SIDES[side]}_{finger}_tip"
        added[f"contacts.{name}"] = {"at": ["0 deg", "0 mm"], "share": 1e-3}
    return both(scenario, added)


def holding(assembly: Assembly, like: ControllerState, hold: list[str]) -> ControllerState:
    """A state in the configuration of `like` with the object in the fingers `hold`."""
    controller, start = assembly.controller, assembly.start
    kin, n = controller.law.kin, assembly.controller.law.kin.grasp.count
    place = like.phase.motion
    reference = kin.reference._replace(position=place.position[1], rotation=place.rotation)
    xi, reach, mode = np.zeros((n, 2)), np.zeros(n), np.zeros(n, dtype=np.int64)
    kin.update(like.q, start.contact._replace(mode=mode), reference)
    for i, name in enumerate(kin.grasp.fingers):
        x, y, z = reference.rotation.T @ (kin.robot.position[i] - reference.position)
        xi[i] = np.arctan2(y, x), z
        reach[i] = np.hypot(x, y) - assembly.loaded.scenario.object.surface.radius
        if name in hold:
            mode[i] = ContactMode.FIXED if name.startswith("r_") else ContactMode.SLIDING
    contact = start.contact._replace(xi=xi)
    reference = reference._replace(reach=reach)
    kin.update(like.q, contact._replace(mode=np.zeros(n, dtype=np.int64)), reference)
    contact = contact._replace(mode=mode, pivot=np.array([kin.touch(i) for i in range(n)]))
    current = like.phase.current
    wanted = np.arange(len(controller.task_names)) < len(controller.task_names) - n  # not the tips
    motion = Motion(
        -1.0, 0.5, np.tile(reference.position, (2, 1)), reference.rotation, np.zeros(3),
        np.tile(reach, (2, 1)), np.zeros((2, n, 3)),
    )  # fmt: skip
    state = start._replace(
        q=like.q, contact=contact, activation=Activation(1.0 * wanted, 1.0 * wanted),
        stack=start.stack._replace(wanted=wanted),
        phase=PhaseState(current, 0.0, motion, False, False, ()),
    )  # fmt: skip
    for _ in range(_WARM):
        _, state = controller.step(state)
    return state


def show(scenario: str) -> None:
    """Print both tables."""
    held = load(scenario).scenario.object
    if held is None or held.surface.type != "cylinder":
        raise SystemExit("--growth: contact points are found on a cylinder only")
    whole = both(scenario, {})
    state = shared(whole[0])
    ten = ten_fingers(scenario)
    head("contacts")
    for hold in _CONTACTS:
        row(str(len(hold)), ten, holding(ten[0], state, hold))
    scene = whole[0].controller.law.distances.scene
    names = sorted(set(scene.pair_names))
    head("pairs")
    for count in _PAIRS:
        step = len(names) * count / len(scene.pair_names)
        chosen = [names[int(k)] for k in np.linspace(0, len(names) - 1, round(step))]
        fewer = both(scenario, {"robot.collisions.pairs": chosen})
        row(str(len(fewer[0].pairs.kept)), fewer, state)
    row(str(len(scene.pair_names)), whole, state)

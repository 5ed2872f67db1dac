"""What bears the object before fingers do, and the check of a table: that it can lie there."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.errors import WbcError
from wbc.rotations import rotation_from_quaternion
from wbc.scenario.dynamic_blocks import Table
from wbc.scenario.schema import Scenario
from wbc.scenario.wording import Fault, Faults, KeyPath
from wbc.sim.mujoco_table import underside

_TABLE: KeyPath = ("simulation", "physics", "table")
_INTO = 1e-4  # a top that reaches no further into the object is pushed out unseen, [m]


def release(scenario: Scenario) -> int | None:
    """The phase at whose start a fixture lets go; None: there is no fixture.

    The compliant engine has no table: a fixture takes its place until the object is to move.
    """
    physics = scenario.simulation.physics
    if physics.fixture is not None:
        return [phase.name for phase in scenario.phases].index(physics.fixture)
    if physics.table is None or scenario.simulation.engine == "mujoco":
        return None
    moves = [k for k, phase in enumerate(scenario.phases) if phase.object is not None]
    return moves[0] if moves else len(scenario.phases)


def borne(scenario: Scenario, k: int) -> bool:
    """Whether something else than fingers bears the object as phase k begins."""
    until = release(scenario)
    table = scenario.simulation.physics.table is not None
    return (until is not None and k < until) or (table and scenario.simulation.engine == "mujoco")


def check_table(scenario: Scenario, surface: Surface) -> list[Fault]:
    """Faults of a table on which the object, where it is believed to be, does not come to rest.

    Posts that a top or a fixture helps need not carry the object by themselves.
    """
    faults, thing, physics = Faults([]), scenario.object, scenario.simulation.physics
    table = physics.table
    if thing is None or table is None or scenario.simulation.engine == "kinematic":
        return []
    rotation = rotation_from_quaternion(np.array(thing.pose.xyzw))
    bottom = float((surface.mesh()[0] @ rotation[2]).min()) + thing.pose.xyz[2]
    bears = physics.fixture is not None
    if table.height is not None:
        _top(table.height, bottom, faults)
        bears = bears or table.height > bottom - _INTO
    if _heads(table, surface, rotation, faults) and table.posts and not bears:
        _carried(np.array(table.posts), (rotation @ np.array(thing.com))[:2], faults)
    return faults.found


def _top(height: float, bottom: float, faults: Faults) -> None:
    """The object is not in the top."""
    if height > bottom + _INTO:
        faults.add(
            (*_TABLE, "height"),
            f"the top is {1e3 * (height - bottom):.3g} mm above the object's underside: at most "
            f"{bottom:.4g} m, or put the object higher",
        )


def _heads(table: Table, surface: Surface, rotation: Array, faults: Faults) -> bool:
    """Whether every post has something to bear."""
    good = True
    for k, across in enumerate(table.posts):
        try:
            underside(surface, rotation, np.array(across))
        except WbcError:
            text = f"nothing of the object is above {_place(across)}: put the post below it"
            faults.add((*_TABLE, "posts", k), text)
            good = False
    return good


def _carried(posts: Array, com: Array, faults: Faults) -> None:
    """The centre of mass is above the inside of the posts' hull: no half turn without a post."""
    away = posts - com
    turn = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    gaps = np.diff(turn, append=turn[0] + 2.0 * np.pi)
    if gaps.max() < np.pi - 1e-9 and np.linalg.norm(away, axis=1).min() > 0.0:
        return
    k = int(gaps.argmax())
    lacking = turn[k] + 0.5 * gaps[k]
    axis = ("+x", "+y", "-x", "-y")[round(lacking / (0.5 * np.pi)) % 4]
    faults.add(
        (*_TABLE, "posts"),
        f"do not carry the object: its centre of mass, above {_place(com)}, is not between them: "
        f"put three or more about it, here one towards {axis}",
    )


def _place(across: Array | tuple[float, float]) -> str:
    x, y = 1e3 * across[0], 1e3 * across[1]
    return f"[{x:.4g} mm, {y:.4g} mm] from its position"

"""The largest mass one hand holds: computed from friction and torque limits, against physics.

    OMP_NUM_THREADS=1 python -m benchmarks.largest_mass [--within 0.03]

Computed: the load factor of the planner at the posture in which the hand lifts, for the friction
that the pads have (0.8) and for the one planned with. Shown, in MuJoCo: the right hand lifts the
object by 5 cm and holds it for 1.5 s; it holds if no contact slips by 3 mm and the object is within
5 mm of where it should be. Between a mass that holds and one that does not the interval is halved.
Where the object is heavier than the planner can hold, it is told of 97 % of what it can.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic

PADS = 0.8
HAND = {
    "*_thumb_*": "0.5 Nm", "*_index_*": "0.075 Nm", "*_middle_*": "0.075 Nm",
    "*_ring_*": "0.075 Nm", "*_little_*": "0.075 Nm",
}  # fmt: skip
"""The torque limits of the chapter's hand."""
_SLIP, _WAY = 3e-3, 5e-3
_HOLD, _TOLD = 1.5, 0.97
_WEIGHTS = {"forces.w_bF": 1e-2, "forces.w_bT": 1e-4}


@dataclass(frozen=True)
class Held:
    """How an object was held.

    Attributes:
        holds: to the end, where it should be.
        slip, way: largest slip of a contact, and distance of the object from its reference [m].
        torque: largest share of its limit that a finger's joint was asked for.
    """

    holds: bool
    slip: float
    way: float
    torque: float


@dataclass(frozen=True)
class Case:
    """A hand and an object.

    Attributes:
        scenario: whose right hand lifts.
        settings: changes of it.
    """

    scenario: str
    settings: tuple[tuple[str, Any], ...] = ()

    def given(self, mass: float, **more: Any) -> dict[str, Any]:
        """Overrides for an object of this mass, lifted and held."""
        own = load(self.scenario)
        lift = next(k for k, phase in enumerate(own.scenario.phases) if phase.object is not None)
        thing = own.scenario.object
        assert thing is not None and thing.mass is not None
        inertia = [x * mass / thing.mass for x in thing.inertia]
        return {
            "simulation.integrator": "euler", "forces.torque_limits": HAND, **_WEIGHTS,
            "object.mass": mass, "object.inertia": inertia, "forces.estimate": None,
            f"phases.{lift}.over": "1 s", f"phases.{lift}.until": {"time": f"{1.0 + _HOLD} s"},
            f"phases.{lift}.timeout": {"after": f"{2.0 + _HOLD} s", "then": "stop"},
            **dict(self.settings), **more,
        }  # fmt: skip


BAR = Case("dual_arm_exchange_mujoco")
ABOVE = Case("dual_arm_exchange_mujoco", (("object.com", (0.0, 0.0, -0.056)),))
BALL = Case("ball_exchange_mujoco")
CASES: Mapping[str, Case] = {
    "bar, its centre 56 mm from the thumb": BAR,
    "bar, its centre above the thumb": ABOVE,
    "ball": BALL,
}


def _lifting(assembly: Assembly) -> int:
    phases = assembly.controller.phases.phases
    return next(k for k, phase in enumerate(phases) if phase.object_motion is not None)


@cache
def computed(case: Case, friction: float) -> float:
    """Largest mass [kg] that the right hand's contacts hold still after the lift."""
    mass = 0.01
    given = case.given(mass, **{"forces.friction": friction})
    assembly = build(load(case.scenario, given))
    controller, state, lift = assembly.controller, assembly.start, _lifting(assembly)
    assert controller.planner is not None
    record, state = controller.step(state)
    for _ in range(assembly.ticks):
        record, state = controller.step(state)
        if record.phase == lift and record.t > state.phase.since + 1.0:
            break
    factor = controller.planner.at_rest(controller.law.kin, record.t, state.phase)[1]
    return mass * factor


def held(case: Case, mass: float, friction: float) -> Held:
    """What physics does with a mass [kg], the forces planned with this friction."""
    told = min(mass, _TOLD * computed(case, friction))
    plan = {"forces.friction": friction}
    assembly = build(load(case.scenario, case.given(told, **plan)))
    dynamics = build_dynamics(build(load(case.scenario, case.given(mass, **plan))))
    assert dynamics is not None
    lift, fingers = _lifting(assembly), dynamics.second.fingers
    limit = dynamics.second.gains.tau_max[fingers]
    slip = way = torque = 0.0
    for record, _ in dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics):
        true = record.dynamics
        assert true is not None
        if record.phase > lift:
            break
        slip = float(true.slip.max())
        way = float(np.linalg.norm(true.object_position - record.reference_position))
        if not (slip < _SLIP and way < _WAY):
            return Held(False, slip, way, torque)
        if record.phase == lift:
            torque = max(torque, float((np.abs(true.tau[fingers]) / limit).max()))
    return Held(True, slip, way, torque)


def shown(case: Case, friction: float, within: float = 0.03) -> tuple[float, float]:
    """A mass that physics holds and one that it does not [kg], as near as `within` says."""
    bound = computed(case, PADS)
    low, high = 0.5 * computed(case, friction), 1.5 * bound
    while high - low > within * bound:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if held(case, middle, friction).holds else (low, middle)
    return low, high


def main() -> None:
    """Print a row a case and a friction planned with."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--within", type=float, default=0.03, help="of the largest mass")
    within = parser.parse_args().within
    for name, case in CASES.items():
        print(f"{name}: computed at {PADS}: {computed(case, PADS):.3f} kg", flush=True)
        for friction in (0.4, 0.6, 0.8):
            said, (low, high) = computed(case, friction), shown(case, friction, within)
            found = f"computed {said:.3f}, physics holds {low:.3f} and not {high:.3f} kg"
            print(f"  planned with {friction}: {found}", flush=True)


if __name__ == "__main__":
    main()

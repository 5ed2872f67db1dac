"""Runs of a scenario as arrays, and the laws that every run keeps whatever happens in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.control.controller import Controller
from wbc.control.state import ControllerState, Measurement, Status, TickRecord
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

REFERENCE = "planar_exchange"
ROUNDING = 1e-9

Edit = Callable[[Controller, ControllerState], ControllerState]
"""What a user does to a live state before a tick."""
Sense = Callable[[ControllerState], Measurement | None]
"""What the robot reports; by default it is exactly where it was told to be."""


@dataclass(frozen=True)
class Run:
    """One run: what was built, every record, and the state after the last tick.

    Attributes:
        velocity_before: (nv,) velocity that the robot started with.
    """

    assembly: Assembly
    records: list[TickRecord]
    state: ControllerState
    velocity_before: np.ndarray

    def series(self, name: str) -> np.ndarray:
        """One field of all records, stacked."""
        return np.array([getattr(record, name) for record in self.records])

    @cached_property
    def t(self) -> np.ndarray:
        return self.series("t")

    @cached_property
    def q(self) -> np.ndarray:
        """(T + 1, nv) positions, the one after the last tick included."""
        return np.vstack([self.series("q"), self.state.q])

    @cached_property
    def v(self) -> np.ndarray:
        return self.series("v")

    @cached_property
    def velocity_steps(self) -> np.ndarray:
        """(T,) largest change of a joint's velocity into each tick, [rad/s]."""
        all_v = np.vstack([self.velocity_before, self.v])
        return np.abs(np.diff(all_v, axis=0)).max(axis=1)

    @cached_property
    def events(self) -> list[tuple[int, str, bool]]:
        """Tick, task and whether it came in, of every decision of the supervisor."""
        names = self.assembly.controller.task_names
        return [
            (k, names[record.event.task], record.event.inserted)
            for k, record in enumerate(self.records)
            if record.event is not None
        ]

    @cached_property
    def object_error(self) -> np.ndarray:
        """(T,) worst position error of the object by any finger that holds it, [m]."""
        return np.nanmax(self.series("object_error")[:, :, 0], axis=1)

    def phase_start(self, name: str) -> float:
        """Time at which a phase begins, [s]; it must have begun."""
        names = [phase.name for phase in self.assembly.controller.phases.phases]
        return float(self.t[np.flatnonzero(self.series("phase") == names.index(name))[0]])

    @cached_property
    def status(self) -> Status:
        """Everything that gave way in any tick."""
        return Status(int(np.bitwise_or.reduce(self.series("status").astype(np.int64))))


def assemble(scenario: Any = REFERENCE, overrides: Mapping[str, Any] | None = None) -> Assembly:
    """A scenario, built."""
    return build(load(scenario, overrides=overrides))


def simulate(
    scenario: Any = REFERENCE,
    overrides: Mapping[str, Any] | None = None,
    *,
    ticks: int | None = None,
    assembly: Assembly | None = None,
    start: ControllerState | None = None,
    edits: Mapping[int, Edit] | None = None,
    sense: Sense | None = None,
    to_the_end: bool = False,
) -> Run:
    """Run a scenario on the ideal robot.

    Args:
        ticks: how many; by default all that the scenario asks for.
        assembly: what to run instead of building the scenario.
        start: state to start from instead of the scenario's.
        edits: by tick, what a user does before it.
        sense: what the robot reports before a tick.
        to_the_end: stop when the last phase has ended or one has stopped the sequence.
    """
    assembly = assembly or assemble(scenario, overrides)
    controller = assembly.controller
    state = first = start if start is not None else assembly.start
    records = []
    for k in range(assembly.ticks if ticks is None else ticks):
        if edits and k in edits:
            state = edits[k](controller, state)
        measurement = Measurement(state.q) if sense is None else sense(state)
        record, state = controller.step(state, measurement)
        records.append(record)
        if to_the_end and (state.phase.done or state.phase.stopped):
            break
    return Run(assembly, records, state, first.v)


def check_laws(run: Run) -> None:
    """Finite, inside the hard limits, accelerations kept unless reported, main task never out."""
    settings, dt = run.assembly.controller.settings, run.assembly.controller.settings.dt
    for name in ("q", "v", "task_error", "activation", "cost", "residuals", "contact_points"):
        assert np.isfinite(run.series(name)).all(), name
    assert np.isfinite(run.q).all()
    errors = run.series("object_error")
    held = run.series("mode") > 0
    assert np.isfinite(errors[held]).all() and np.isnan(errors[~held]).all()
    assert (np.abs(run.v) <= settings.velocity + ROUNDING).all(), "velocity limit"
    # a joint that starts outside may only come back
    low = np.minimum(settings.lower, run.q[0]) - ROUNDING
    high = np.maximum(settings.upper, run.q[0]) + ROUNDING
    assert (run.q >= low).all() and (run.q <= high).all(), "position limit"
    np.testing.assert_allclose(run.q[1:], run.q[:-1] + dt * run.v, atol=1e-12)
    clipped = np.array([record.limited.clipped for record in run.records])
    steps = np.abs(np.diff(np.vstack([run.velocity_before, run.v]), axis=0))
    beyond = (steps > settings.acceleration * dt + ROUNDING).any(axis=1)
    assert not (beyond & ~clipped).any(), "acceleration limit passed and not reported"
    status = run.series("status").astype(np.int64)
    assert ((status & Status.CLIPPED > 0) == clipped).all()
    check_main_task(run)


def check_main_task(run: Run) -> None:
    """Every finger that a phase says holds the object has its rows in the main task, every tick."""
    phases = run.assembly.controller.phases.phases
    modes = np.array([phases[record.phase].mode for record in run.records])
    np.testing.assert_array_equal(run.series("mode"), modes)


def capsules(run: Run, links: list[str]) -> np.ndarray:
    """(T, n, 2, 2) end points of the axes of links' capsules, in the plane; [m]."""
    model = run.assembly.model
    shapes = {model.pin_model.frames[o.parentFrame].name: o for o in model.geometry.geometryObjects}
    data = model.pin_model.createData()
    axes = np.empty((len(run.records), len(links), 2, 2))
    for k, record in enumerate(run.records):
        pin.forwardKinematics(model.pin_model, data, model.full(record.q))
        for n, link in enumerate(links):
            shape = shapes[link]
            place = data.oMi[shape.parentJoint] * shape.placement
            half = np.array([0.0, 0.0, shape.geometry.halfLength])
            axes[k, n] = place.act(-half)[:2], place.act(half)[:2]
    return axes


def segment_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(T,) distances of planar segments (T, 2, 2), 0 where they cross: written apart from coal."""

    def cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]

    def to_point(segment: np.ndarray, point: np.ndarray) -> np.ndarray:
        way = segment[:, 1] - segment[:, 0]
        share = np.sum((point - segment[:, 0]) * way, axis=1) / np.sum(way * way, axis=1)
        foot = segment[:, 0] + np.clip(share, 0.0, 1.0)[:, None] * way
        return np.linalg.norm(point - foot, axis=1)

    near = np.min(
        [to_point(a, b[:, 0]), to_point(a, b[:, 1]), to_point(b, a[:, 0]), to_point(b, a[:, 1])],
        axis=0,
    )
    u, w = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]
    sides_b = cross(u, b[:, 0] - a[:, 0]) * cross(u, b[:, 1] - a[:, 0])
    sides_a = cross(w, a[:, 0] - b[:, 0]) * cross(w, a[:, 1] - b[:, 0])
    return np.where((sides_a < 0.0) & (sides_b < 0.0), 0.0, near)


def link_distances(run: Run) -> dict[tuple[str, str], np.ndarray]:
    """(T,) distance of every two links that share no joint and no branch point, by `capsules`.

    All pairs, also those that the scenario does not watch: nothing may pass through anything.
    """
    model = run.assembly.model
    shapes = list(model.geometry.geometryObjects)
    links = [model.pin_model.frames[o.parentFrame].name for o in shapes]
    parents = model.pin_model.parents
    axes = capsules(run, links)
    found = {}
    for i, a in enumerate(shapes):
        for j in range(i):
            b = shapes[j]
            pa, pb = a.parentJoint, b.parentJoint
            if parents[pa] == pb or parents[pb] == pa or parents[pa] == parents[pb] > 0:
                continue
            apart = segment_distances(axes[:, i], axes[:, j])
            found[links[j], links[i]] = apart - a.geometry.radius - b.geometry.radius
    return found


def finger_distance(run: Run) -> np.ndarray:
    """(T,) smallest distance of two links of different fingers, or of one that can meet."""
    pairs = link_distances(run)
    fingers = [d for names, d in pairs.items() if all("finger" in name for name in names)]
    return np.min(fingers, axis=0)


def equilibrium(run: Run, fingers: list[str]) -> np.ndarray:
    """(T, 2) ε_f and ε_m of (44)-(45) over some fingers, from the logged points and normals."""
    names = run.assembly.controller.law.kin.grasp.fingers
    pick = [names.index(finger) for finger in fingers]
    normals = run.series("contact_normals")[:, pick]
    arms = run.series("contact_points")[:, pick] - run.series("object_position")[:, None]
    force, moment = normals.sum(axis=1), np.cross(arms, normals).sum(axis=1)
    return 0.5 * np.stack([np.sum(force**2, axis=1), np.sum(moment**2, axis=1)], axis=1)

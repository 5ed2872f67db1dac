"""Laws of the loop: what a tick promises, checked from outside on live runs."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.contact.extended_finger import extended_jacobian
from wbc.control.references import References
from wbc.control.state import ControllerState, Measurement, TickRecord

from .runs import REFERENCE, Run, assemble, check_laws, simulate

# A short exchange in which everything happens: an event at 0.19 s, contact at 0.8 s, sliding after.
SHORT = 0.9
PHASES = ("approach", "slide", "hand_over", "leave", "carry")
NONE = {f"phases.{phase}.tasks": [] for phase in PHASES} | {"costs": {}}
MOVING = {
    "phases.slide.object": {
        "target": {"position": [0.05, -0.03], "angle": "6 deg"},
        "relative": True,
    },
    "phases.slide.over": "1.5 s",
    "simulation.duration": "2.3 s",
}


def arrays(value: Any) -> Iterator[np.ndarray]:
    """Every array in a state or record, however deep."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for entry in value:
            yield from arrays(entry)


def fingerprint(values: Any, leave_out: str = "") -> str:
    """A digest of every bit of every array and number, but of a field of records if asked for."""
    digest = hashlib.sha256()

    def feed(value: Any) -> None:
        if isinstance(value, np.ndarray):
            digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        elif isinstance(value, TickRecord) and leave_out:
            feed([x for name, x in value._asdict().items() if name != leave_out])
        elif isinstance(value, tuple | list):
            for entry in value:
                feed(entry)
        elif isinstance(value, float):
            digest.update(np.float64(value).tobytes())
        else:
            digest.update(repr(value).encode())

    feed(values)
    return digest.hexdigest()


def apart_from_coal(records: Any) -> str:
    """`fingerprint` for comparing different histories, without the smallest distance.

    coal's solver, which Pinocchio keeps per pair, starts where its last query ended: the same
    placement measures differently in the last bit after another history.
    """
    return fingerprint(records, leave_out="min_distance")


def freeze(state: ControllerState) -> ControllerState:
    """The same state; whoever writes into it gets an error."""
    for array in arrays(state):
        array.setflags(write=False)
    return state


def ticks(seconds: float) -> int:
    return round(seconds / 2e-3)


def test_the_command_solves_the_published_equation_every_tick() -> None:
    """J̃ ṽ = Gᵀ (v_d + K e) of (35), J̃ built apart from the elimination that the tick uses."""
    run = assemble(overrides={"simulation.integrator": "euler", "phases.0.until.tip_error": "1 mm"})
    observer = assemble().controller.law.kin  # workspaces of its own
    state, worst = run.start, 0.0
    references = References(observer.grasp.count)
    nv, n = len(state.q), observer.grasp.count
    for _ in range(ticks(SHORT)):
        before, tick = state, state.tick
        _, state = run.controller.step(state, Measurement(state.q))
        # the contact modes and motions of the tick are those in force after it began
        contact = before.contact._replace(mode=state.contact.mode)
        if (before.contact.mode != contact.mode).any():
            continue  # new touches set their pivots within the tick
        observer.update(before.q, contact, references.at(2e-3 * tick, state.phase.motion))
        jacobian, wanted = extended_jacobian(observer)
        xi_rate = state.rates[nv : nv + 2 * n].reshape(n, 2)[:, 0]
        pivot_rate = state.rates[nv + 2 * n :].reshape(n, 3)[:, 2]
        v_ext = np.concatenate([state.v, np.stack([xi_rate, pivot_rate], axis=1).ravel()])
        worst = max(worst, np.abs(jacobian @ v_ext - wanted).max())
    print(f"largest residual of (35) in {ticks(SHORT)} ticks: {worst:.2g}")
    assert worst < 1e-12


def test_secondary_tasks_never_touch_the_object() -> None:
    """An object in motion that starts some mm off: the same errors with and without them."""
    runs = {}
    for name, tasks in (("all", {}), ("none", NONE)):
        assembly = assemble(overrides={**MOVING, **tasks})
        start = assembly.start
        nudge = 1e-3 * np.random.default_rng(1).normal(size=len(start.q))
        runs[name] = simulate(assembly=assembly, start=start._replace(q=start.q + nudge))
    errors = {name: run.series("object_error") for name, run in runs.items()}
    apart = np.nanmax(np.abs(errors["all"] - errors["none"]))
    moved = np.ptp(runs["all"].series("object_position")[:, 0])
    driven = np.abs(runs["all"].q - runs["none"].q).max()
    start = np.nanmax(errors["all"][0])
    print(f"error {start:.2g} at first, {moved:.3f} m moved: differs by {apart:.2g}", end="")
    print(f" while joints differ by {driven:.2g} rad")
    assert start > 1e-3 and moved > 0.04 and driven > 0.1
    assert apart < 1e-7
    decay = errors["all"][ticks(0.2), 0] / errors["all"][0, 0]
    np.testing.assert_allclose(decay, np.exp(-20.0 * 0.2), rtol=1e-4)


def test_the_same_run_twice_to_the_last_bit(reference: Run) -> None:
    again = simulate(ticks=ticks(SHORT))
    assert fingerprint(again.records) == fingerprint(reference.records[: ticks(SHORT)])


def test_another_process_to_the_last_bit(reference: Run) -> None:
    """A hash that differs between processes (sets, ids, uninitialised memory) would show here."""
    code = (
        "from exchange.runs import simulate\n"
        "from exchange.test_laws import fingerprint, ticks\n"
        "print(fingerprint(simulate(ticks=ticks(0.3)).records))\n"
    )
    tests = Path(__file__).resolve().parents[1]
    found = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        cwd=tests, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr[-2000:]
    assert found.stdout.strip() == fingerprint(reference.records[: ticks(0.3)])


@pytest.mark.parametrize("at", [0.0, 0.189, 0.191, 0.799, 0.801, 1.7])
def test_a_step_is_a_function_of_its_state(reference: Run, at: float) -> None:
    """The same state steps the same twice and keeps its every bit, whatever was stepped between."""
    controller = reference.assembly.controller
    state = reference.assembly.start
    for record in reference.records[: ticks(at)]:
        _, state = controller.step(state, Measurement(record.q))
    before = fingerprint(state)
    first = controller.step(state, Measurement(state.q))
    noted = apart_from_coal(first)
    other = state._replace(q=state.q + 0.01)
    controller.step(other)  # leaves nothing behind in the workspaces
    second = controller.step(state, Measurement(state.q))
    assert apart_from_coal(second) == noted
    assert abs(second[0].min_distance - first[0].min_distance) < 1e-14
    assert apart_from_coal(first) == noted  # nor does a later step write into an earlier record
    assert fingerprint(state) == before


@pytest.mark.slow  # numba compiles every kernel anew for read-only arrays
def test_a_read_only_state_steps_the_same(reference: Run) -> None:
    """Whoever wrote into a state would raise here, and so would no longer agree."""
    controller = reference.assembly.controller
    state = assemble().start
    for record in reference.records[:120]:
        found, state = controller.step(freeze(state), Measurement(state.q))
        assert apart_from_coal(found) == apart_from_coal(record)


def test_records_and_states_hold_no_workspace(reference: Run) -> None:
    """An array that a later tick overwrites would make the log say what was not."""
    a, b = reference.records[100], reference.records[101]
    for name, x, y in zip(TickRecord._fields, a, b, strict=True):
        if isinstance(x, np.ndarray) and name not in ("mode", "within"):
            assert not np.shares_memory(x, y), name
    law = reference.assembly.controller.law
    spaces = [v for part in (law, law.kin, law.stack) for v in vars(part).values()]
    for space in (v for v in spaces if isinstance(v, np.ndarray)):
        for array in [*arrays(a), *arrays(reference.state)]:
            assert not np.shares_memory(space, array)


def test_interleaved_controllers_and_states(reference: Run) -> None:
    """Two controllers, and two states of one controller, in turn: as if each were alone."""
    one, two = reference.assembly, assemble(overrides={"contacts.f3.at": ["20 deg"]})
    alone = simulate(assembly=two, ticks=150)
    states = {"a": one.start, "b": two.start, "c": two.start}
    for k in range(150):
        for name, assembly in (("a", one), ("b", two), ("c", two)):
            record, states[name] = assembly.controller.step(
                states[name], Measurement(states[name].q)
            )
            expected = (reference if name == "a" else alone).records[k]
            assert apart_from_coal(record) == apart_from_coal(expected), (name, k)


def test_without_a_measurement_nothing_changes(reference: Run) -> None:
    """The first stage runs on its own references; what it is told is only checked."""
    blind = simulate(assembly=reference.assembly, ticks=100, sense=lambda state: None)
    assert apart_from_coal(blind.records) == apart_from_coal(reference.records[:100])


def test_a_start_in_motion_is_taken_up(reference: Run) -> None:
    """A robot that moves at the start is braked into the references, within its limits."""
    assembly = reference.assembly
    v0 = 0.2 * np.random.default_rng(2).normal(size=len(assembly.start.q))
    start = assembly.controller.init(assembly.start.q, v0=v0)
    run = simulate(assembly=assembly, start=start, ticks=300)
    check_laws(run)
    assert np.abs(run.v[0] - v0).max() <= 60.0 * 2e-3 + 1e-9
    assert run.object_error[-1] < 1e-5


def test_the_name_finds_the_scenario_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reference: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    run = simulate(REFERENCE, ticks=3)
    assert fingerprint(run.records) == fingerprint(reference.records[:3])

"""The stack edited while it runs: on the exchange, and on two arms that reach without an object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wbc.control.controller import Controller
from wbc.control.state import ControllerState, Measurement, Status
from wbc.errors import UnknownNameError, WbcError

from .runs import Run, check_laws, simulate

# A fingertip and its palm are sent 0.2 m further apart than the finger is long; the right arm has
# room for all. No joint comes to a limit, no velocity or acceleration either.
REACH = """
name: reach
robot:
  urdf: planar_bimanual
  start:
    left_trunk_1: -40 deg
    left_trunk_2: 70 deg
    left_trunk_3: -30 deg
    left_a_1: 50 deg
    left_a_2: -70 deg
    left_b_1: -50 deg
    left_b_2: 70 deg
    right_trunk_1: 40 deg
    right_trunk_2: -70 deg
    right_trunk_3: 30 deg
tasks:
  first:
    {type: frame_position, frame: left_tip_a, target: [-0.2, 0.5, 0], axes: [x, y], gain: 6 /s,
     saturation: 0.1}
  second:
    {type: frame_position, frame: left_palm, target: [-1.2, -0.6, 0], axes: [x, y], gain: 6 /s,
     saturation: 0.1}
  right:
    {type: frame_position, frame: right_palm, target: [0.9, 0.3, 0], axes: [x, y], gain: 4 /s,
     saturation: 0.1}
  rest: {type: posture, gain: 2 /s, saturation: 0.3}
stack: {priority: [first, second, right, rest]}
limits: {acceleration: 40 rad/s^2}
simulation: {duration: 2.5 s, step: 2 ms}
"""


@pytest.fixture(scope="module")
def reach_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("reach") / "reach.yaml"
    path.write_text(REACH)
    return path


@pytest.fixture(scope="module")
def reached(reach_file: Path) -> Run:
    return simulate(reach_file)


def errors(run: Run, task: str) -> np.ndarray:
    """(T,) |e| of a task."""
    return run.series("task_error")[:, run.assembly.controller.task_names.index(task)]


def test_two_arms_reach(reached: Run) -> None:
    check_laws(reached)
    assert reached.status == Status.OK
    assert errors(reached, "first")[-1] < 1e-4
    assert errors(reached, "right")[-1] < 1e-3
    assert errors(reached, "second")[-1] > 0.18  # out of reach, and that is all right
    assert np.abs(reached.v[-1]).max() < 0.01


def test_lower_priorities_never_change_a_higher_error(reach_file: Path) -> None:
    """With every gain at 1 from the start: while a level fades in, those below still move it."""
    at_once = {"supervisor.smoothing": "off", "limits.acceleration": None}
    every = simulate(reach_file, at_once)
    for upper in (["first"], ["first", "second"], ["first", "second", "right"]):
        alone = simulate(reach_file, {**at_once, "stack.priority": upper})
        apart = [np.abs(errors(alone, task) - errors(every, task)).max() for task in upper]
        print(f"{upper} with and without the levels below differ by {np.max(apart):.2g} m")
        assert apart[0] < 1e-7
        # second meets its limit of reach, where its rows lose rank and the integrator its order
        assert np.max(apart) < 1e-4
        assert np.abs(alone.state.q - every.state.q).max() > 5e-3


def test_the_order_decides(reach_file: Path, reached: Run) -> None:
    swapped = simulate(reach_file, {"stack.priority": ["second", "first", "right", "rest"]})
    check_laws(swapped)
    assert errors(swapped, "second")[-1] < 1e-4
    assert errors(swapped, "first")[-1] == pytest.approx(errors(reached, "second")[-1], rel=1e-3)


def test_reaching_does_not_depend_on_the_tick(reach_file: Path) -> None:
    """Runge-Kutta, before anything is near the limit of its reach: fourth order."""
    ends = {}
    for step in (1, 2, 4):
        run = simulate(reach_file, {"simulation.step": f"{step} ms"}, ticks=100 // step)
        ends[step] = run.state.q
    fine = np.abs(ends[1] - ends[2]).max()
    coarse = np.abs(ends[2] - ends[4]).max()
    print(f"reach: order {np.log2(coarse / fine):.2f}")
    assert coarse < 1e-8
    assert np.log2(coarse / fine) > 3.7


ORDER = ["second", "first", "right", "rest"]


def test_reordering_alive(reach_file: Path) -> None:
    """The tasks that change place fade out, change, and fade in: nothing jumps."""
    at = 100
    edited = simulate(reach_file, edits={at: lambda c, s: c.reorder(s, ORDER)})
    check_laws(edited)
    step = edited.velocity_steps[at - 1 : at + 400].max()
    print(f"reordered in motion: velocity step {step:.4f} rad/s")
    assert step < 0.02
    names = edited.assembly.controller.task_names
    assert [names[k] for k in edited.state.order] == ORDER
    assert edited.state.next_order is None
    fresh = simulate(reach_file, {"stack.priority": ORDER})
    for task in ("first", "second", "right"):
        assert errors(edited, task)[-1] == pytest.approx(errors(fresh, task)[-1], abs=5e-3)


def test_reordering_tasks_that_are_stuck_against_each_other(reach_file: Path) -> None:
    """There a hair of the upper task's gain sets the lower one free: the filter keeps the step."""
    at = 1000
    run = simulate(reach_file, edits={at: lambda c, s: c.reorder(s, ORDER)}, ticks=2500)
    check_laws(run)
    step = run.velocity_steps[at - 1 :].max()
    print(f"reordered while stuck: velocity step {step:.4f} rad/s")
    assert step <= 40.0 * 2e-3 + 1e-9
    assert errors(run, "second")[-1] < 1e-3


@pytest.mark.parametrize("seed", range(2))
def test_a_user_at_play(reach_file: Path, seed: int) -> None:
    """Insertions, removals, orders and targets at random: the laws hold and it still converges."""
    random = np.random.default_rng(seed)
    names = ["first", "second", "right", "rest"]

    def play(controller: Controller, state: ControllerState) -> ControllerState:
        what = random.integers(4)
        task = str(random.choice(names))
        if what == 0:
            return controller.insert(state, task)
        if what == 1:
            return controller.remove(state, task)
        if what == 2:
            return controller.reorder(state, [str(name) for name in random.permutation(names)])
        return controller.retarget(state, "first", random.normal(scale=0.3, size=3))

    edits = {int(k): play for k in np.sort(random.integers(0, 1000, 25))}
    run = simulate(reach_file, edits=edits, ticks=1100)
    check_laws(run)
    assert run.velocity_steps.max() <= 40.0 * 2e-3 + 1e-9
    controller, state = run.assembly.controller, run.state
    for name in names:
        state = controller.insert(state, name)
    state = controller.reorder(controller.retarget(state, "first", [-0.2, 0.5, 0.0]), names)
    last = simulate(assembly=run.assembly, start=state, ticks=1500)
    assert errors(last, "first")[-1] < 1e-3


def test_insert_and_remove_on_the_exchange(reference: Run) -> None:
    """A task goes and comes back at the user's word, in the middle of the slide."""

    def edit(what: str, task: str):  # type: ignore[no-untyped-def]
        return lambda controller, state: getattr(controller, what)(state, task)

    edits = {450: edit("remove", "moment"), 700: edit("insert", "moment")}
    edits |= {800: edit("remove", "force"), 900: edit("insert", "force")}
    run = simulate(overrides={"phases.slide.timeout.after": "3.5 s"}, edits=edits, ticks=1900)
    check_laws(run)
    names = run.assembly.controller.task_names
    moment = run.series("activation")[:, names.index("moment")]
    assert moment[449] > 0.99 and moment[690] < 0.02 and moment[1200] > 0.99
    assert run.object_error[run.t > 0.3].max() < 1e-8
    assert run.state.phase.timeouts == () and max(run.records[-1].residuals) < 1e-6
    around = np.concatenate([np.arange(k, k + 150) for k in edits])
    assert run.velocity_steps[around].max() < 0.05


def test_editing_is_a_value(reference: Run) -> None:
    """An edit makes a new state; the old one steps as before."""
    controller = reference.assembly.controller
    state = reference.assembly.start
    edited = controller.remove(state, "force")
    assert edited is not state and state.stack.wanted[0] and not edited.stack.wanted[0]
    assert controller.insert(edited, "force").stack.wanted[0]
    same = controller.reorder(state, ["force", "moment", "dexterity", "palm"])
    _, after = controller.step(same, Measurement(state.q))
    assert after.order == state.order and after.next_order is None


def test_unknown_names(reference: Run, reached: Run) -> None:
    controller, state = reference.assembly.controller, reference.assembly.start
    for edit in (controller.insert, controller.remove):
        with pytest.raises(UnknownNameError, match="did you mean 'moment'"):
            edit(state, "momnet")
    with pytest.raises(UnknownNameError, match="palm"):
        controller.retarget(state, "palms", np.zeros(3))
    for order in (["force"], ["force", "moment", "dexterity", "dexterity"], ["object", "force"]):
        with pytest.raises(WbcError):
            controller.reorder(state, order)
    reach, at = reached.assembly.controller, reached.assembly.start
    for target in (np.zeros(2), [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], np.zeros((3, 1))):
        with pytest.raises(ValueError, match="'first' takes a finite target of shape"):
            reach.retarget(at, "first", target)
    with pytest.raises(ValueError, match="no target"):
        controller.retarget(state, "force", np.zeros(1))

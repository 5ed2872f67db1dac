"""Forces planned in the loop: balance, limits, passages between sets of contacts, bad ticks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from forces.oracles import load_factor

from wbc.control.force_planner import Passage, passages
from wbc.control.hand_statics import statics, touches, touches_at
from wbc.control.phases import ObjectMotion, Phase
from wbc.control.rehearsal import rehearse
from wbc.control.state import ControllerState, ForceRecord, Status, TickRecord
from wbc.forces import ForceStatus
from wbc.robot.kinematics import Kinematics
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

from .holding import LIFT, holding

STATUS = tuple(ForceStatus)
SOFT = {"model": "soft_finger", "friction": 0.7, "torsion": "6 mm"}


@pytest.fixture(scope="module")
def held() -> Assembly:
    return holding()


def run(
    assembly: Assembly, ticks: int, state: ControllerState | None = None
) -> tuple[list[TickRecord], ControllerState]:
    state, records = assembly.start if state is None else state, []
    for _ in range(ticks):
        record, state = assembly.controller.step(state)
        records.append(record)
    return records, state


def plan(record: TickRecord) -> ForceRecord:
    assert record.forces is not None
    return record.forces


def supplied(record: TickRecord) -> np.ndarray:
    """(6,) what the logged forces exert about the object's origin."""
    forces = plan(record)
    arms = record.contact_points - record.object_position
    moments = np.cross(arms, forces.force) - forces.spin[:, None] * record.contact_normals
    return np.concatenate([forces.force.sum(0), moments.sum(0)])


def assert_good(record: TickRecord) -> None:
    forces = plan(record)
    assert STATUS[forces.status] is ForceStatus.SOLVED
    size = np.abs(forces.force).max()
    np.testing.assert_allclose(supplied(record), forces.wrench, atol=1e-9 * max(size, 1.0))
    in_contact = record.mode != 0
    assert np.isnan(forces.cone_margin[~in_contact]).all()
    assert (forces.cone_margin[in_contact] >= 0.0).all()
    assert (forces.torque_margin > 0.0).all()
    assert (forces.force[~in_contact] == 0.0).all()


def test_every_tick_balances_within_all_limits(held: Assembly) -> None:
    records, _ = run(held, 60)
    for record in records:
        assert_good(record)
    forces = [plan(r) for r in records]
    assert max(f.iterations for f in forces[1:]) <= 3  # at an acceleration of 0.6 g
    steps = np.abs(np.diff([f.force for f in forces], axis=0)).max(axis=(1, 2))
    assert steps.max() < 0.05 * forces[0].sum_normal
    # the weight is lifted: more than it while speeding up, less while slowing down
    up = np.array([f.wrench[2] for f in forces]) / (0.03 * 9.81)
    assert up[12] > 1.5 and up[37] < 0.5 and up[55] == pytest.approx(1.0, abs=1e-9)
    arm = records[-1].reference_rotation @ [0.0, 2e-3, 1e-3]
    np.testing.assert_allclose(forces[-1].com - records[-1].object_position, arm, atol=1e-7)


def test_the_torques_are_those_of_inverse_dynamics_with_forces_on_the_links(
    held: Assembly,
) -> None:
    records, state = run(held, 20)
    records, _ = run(held, 1, state)
    record, model = records[0], held.model
    robot = Kinematics(model, held.controller.law.kin.robot.frames).update(record.q)
    a = (state.v - state.forces.v) / held.controller.settings.dt if state.forces else 0.0
    fext = pin.StdVec_Force()
    for _ in range(model.pin_model.njoints):
        fext.append(pin.Force.Zero())
    for i, force in enumerate(plan(record).force):
        joint = model.pin_model.frames[model.frame(robot.frames[i])].parentJoint
        reaction = pin.Force(-force, np.cross(record.contact_points[i], -force))
        fext[joint] += robot.data.oMi[joint].actInv(reaction)
    tau = pin.rnea(
        model.pin_model, model.pin_model.createData(), model.full(record.q),
        model.ratio * state.v[model.master], model.ratio * a[model.master], fext,
    )  # fmt: skip
    expected = np.zeros(model.nv)
    np.add.at(expected, model.master, model.ratio * tau)
    np.testing.assert_allclose(plan(record).torque, expected, atol=1e-9)


def test_no_other_forces_would_do_with_less(held: Assembly) -> None:
    _, state = run(held, 10)
    exact = holding(forces__method="exact")
    least, _ = run(exact, 11)
    newton, _ = run(held, 1, state)
    assert_good(newton[0])
    assert plan(least[-1]).sum_normal <= plan(newton[0]).sum_normal
    assert abs(plan(least[-1]).cone_margin.min()) < 1e-6
    np.testing.assert_allclose(supplied(least[-1]), plan(least[-1]).wrench, atol=1e-8)


def problem_of(assembly: Assembly, k: int, records: list[TickRecord]) -> Any:
    """The problem of tick k from what a log holds."""
    planner, now = assembly.controller.planner, records[k]
    assert planner is not None
    robot = Kinematics(assembly.model, assembly.controller.law.kin.robot.frames).update(now.q)
    n = len(now.mode)
    touch = touches_at(
        now.contact_points, now.contact_normals, robot.position[:n], now.object_position
    )
    v, dt = records[k - 1].v, assembly.controller.settings.dt
    a = (v - records[k - 2].v) / dt
    return planner.problem(robot, now.mode, touch, v, a, plan(now).wrench)


def test_a_problem_can_be_had_back_from_a_log(held: Assembly) -> None:
    from wbc.forces.solver import ForceSolver

    records, _ = run(held, 20)
    problem = problem_of(held, 19, records)
    again = ForceSolver(problem).solve(problem.G, problem.J, problem.tau_e, problem.h_e)
    forces = plan(records[19])
    assert again.phi == pytest.approx(forces.phi, rel=1e-6)
    np.testing.assert_allclose(again.cone_margin, forces.cone_margin, rtol=1e-3)


def test_a_jump_of_the_wrench_is_survived(held: Assembly) -> None:
    planner = held.controller.planner
    assert planner is not None
    records, state = run(held, 55)
    own = planner.payload
    try:
        planner.payload = replace(own, mass=3.0 * own.mass)
        jumped, state = run(held, 1, state)
    finally:
        planner.payload = own
    back, _ = run(held, 1, state)
    for record in (*jumped, *back):
        assert_good(record)
    assert plan(jumped[0]).sum_normal > 2.0 * plan(records[-1]).sum_normal


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"mass": 0.5}, ForceStatus.INFEASIBLE_TORQUE_LIMITS),
        ({"mass": np.nan}, ForceStatus.INVALID_INPUT),
        ({"com": np.array([0.0, np.nan, 0.0])}, ForceStatus.INVALID_INPUT),
    ],
)
def test_a_tick_that_cannot_be_held_keeps_the_last_forces_and_says_why(
    held: Assembly, change: dict[str, Any], status: ForceStatus
) -> None:
    planner = held.controller.planner
    assert planner is not None
    _, before = run(held, 10)
    own = planner.payload
    try:
        planner.payload = replace(own, **change)
        records, state = run(held, 3, before)
    finally:
        planner.payload = own
    assert before.forces is not None and state.forces is not None
    np.testing.assert_array_equal(state.forces.c, before.forces.c)
    for record in records:
        forces = plan(record)
        assert STATUS[forces.status] is status
        for value in (forces.force, forces.torque, forces.wrench, forces.com, forces.cone_margin):
            assert np.isfinite(value).all()
        assert np.isfinite([forces.mass, forces.sum_normal]).all()
        assert forces.sum_normal > 0.0
    assert_good(run(held, 1, state)[0][0])


def test_the_verdict_is_clarabels(held: Assembly) -> None:
    records, _ = run(held, 3)
    problem = problem_of(held, 2, records)
    factor = load_factor(problem).value
    assert 3.0 < factor < 8.0  # as the two tests above take it to be
    assert load_factor(problem.with_(h_e=0.99 * factor * problem.h_e)).value > 1.0


def test_planning_leaves_the_motion_as_it_is_bit_for_bit(held: Assembly) -> None:
    records, state = run(held, 30)
    without, other = run(holding(forces=None), 30)
    assert without[0].forces is None and other.forces is None
    np.testing.assert_array_equal(state.q, other.q)
    np.testing.assert_array_equal(records[-1].v, without[-1].v)


def test_a_state_is_a_value(held: Assembly) -> None:
    _, state = run(held, 5)
    one, _ = run(held, 5, state)
    two, _ = run(held, 5, state)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(plan(a).force, plan(b).force)


def hand_over() -> Iterator[dict[str, Any]]:
    """Thumb and middle finger hold, the index finger joins, the middle finger goes."""
    still = {"tasks": [], "over": "0.1 s", "until": {"time": "0.1 s"}}
    two = {"r_thumb": "fixed", "r_middle": "fixed"}
    three = {**two, "r_index": "fixed"}
    yield {**still, "name": "two", "contacts": two, "reach": {"r_index": {"clearance": "0 m"}},
           "until": {"time": "0.1 s", "tip_error": "1e-8 m"}}  # fmt: skip
    yield {"name": "join", "contacts": three, "tasks": [], "until": {"time": "0.01 s"}}
    yield {**still, "name": "leave", "contacts": three}
    yield {**still, "name": "other", "contacts": {"r_thumb": "fixed", "r_index": "fixed"},
           "reach": {"r_middle": {"clearance": "2 mm"}}}  # fmt: skip


def test_forces_pass_from_one_set_of_contacts_to_the_next_without_a_step() -> None:
    assembly = holding(phases=list(hand_over()), mass="20 g", forces={**SOFT, "ramp": "0.06 s"})
    records, _ = run(assembly, 190)
    names = [phase.name for phase in assembly.controller.phases.phases]
    seen = [names[record.phase] for record in records]
    assert sorted(set(seen)) == sorted(names)
    for record in records:
        assert_good(record)
    press = np.linalg.norm([plan(record).force for record in records], axis=2)
    thumb, index, middle = press.T
    joined, left, other = (seen.index(name) for name in ("join", "leave", "other"))
    assert left - joined == 30  # the phase lasts as long as the forces take, 60 ms
    assert index[joined] == 0.0 and index[left] > 0.0
    assert middle[other - 1] < 1e-3 * middle[0] and middle[other] == 0.0
    assert thumb.min() > 0.0
    steps = np.abs(np.diff([plan(r).force for r in records], axis=0)).max()
    assert steps < 0.1 * press.max()


def test_the_first_forces_on_an_object_at_rest_begin_with_none() -> None:
    """What bears it, a table, is left by and by; the fingers balance their part of the load."""
    three = {name: "fixed" for name in ("r_thumb", "r_middle", "r_index")}
    near = {"r_*": {"clearance": "0 m"}}
    phases = [
        {"name": "near", "reach": near, "tasks": [], "until": {"time": "0.02 s"}, "over": "0.02 s"},
        {"name": "grip", "contacts": three, "tasks": [], "until": {"time": "0.1 s"}},
    ]
    given = {"forces": {**SOFT, "ramp": "0.06 s"}, "simulation__physics__table": {"height": "0 m"}}
    assembly = holding(phases=phases, mass="20 g", **given)
    records, _ = run(assembly, 60)
    assert assembly.controller.phases.phases[1].over == pytest.approx(0.06)
    for record in records:
        assert_good(record)
    first = [record.phase for record in records].index(1)
    weight = np.array([plan(record).wrench[2] for record in records]) / (0.02 * 9.81)
    s = np.clip(np.arange(60 - first) * 2e-3 / 0.06, 0.0, 1.0)
    np.testing.assert_allclose(weight[first:], s**3 * (10.0 - 15.0 * s + 6.0 * s**2), atol=1e-3)
    force = np.array([plan(record).force for record in records])
    assert (force[: first + 1] == 0.0).all() and np.linalg.norm(force[-1], axis=1).min() > 0.01
    assert np.abs(np.diff(force, axis=0)).max() < 0.1 * np.abs(force[-1]).max()


def test_a_timeout_that_goes_on_waits_for_forces_that_pass() -> None:
    phases = [*hand_over()]
    phases[1] = {**phases[1], "over": "0.06 s", "until": {"time": "9 s"},
                 "timeout": {"after": "9.5 s", "then": "next"}}  # fmt: skip
    assembly = holding(phases=phases, mass="20 g", forces={**SOFT, "ramp": "0.06 s"})
    sequence = assembly.controller.phases
    early = replace(sequence.phases[1], timeout=0.01)
    join = replace(sequence, phases=(sequence.phases[0], early, *sequence.phases[2:]))
    assembly.controller.phases = join
    records, state = run(assembly, 190)
    assert early.passes and state.phase.timeouts == ("join",)
    forces = [plan(record).force for record in records]
    assert np.abs(np.diff(forces, axis=0)).max() < 0.1 * np.linalg.norm(forces, axis=2).max()


def test_no_finger_goes_whose_leaving_the_others_cannot_bear() -> None:
    """60 g: three fingers hold them, and thumb and index finger, which would be left, do not."""
    assembly = holding(phases=list(hand_over()), mass="60 g", forces={**SOFT, "ramp": "0.06 s"})
    records, _ = run(assembly, 160)
    phases = assembly.controller.phases.phases
    before = [r for r in records if not r.status & Status.UNSUPPORTED]
    for record in before[:-1]:
        assert_good(record)
    waiting = records[len(before) :]
    assert len(waiting) > 20 and phases[waiting[-1].phase].name == "leave"
    for record in waiting:  # only these are called infeasible: the last forces, of all three
        assert record.status & Status.UNSUPPORTED
        assert STATUS[plan(record).status] is ForceStatus.INFEASIBLE_TORQUE_LIMITS
        np.testing.assert_allclose(plan(record).sum_normal, plan(before[-1]).sum_normal)


@pytest.mark.parametrize(
    ("mass", "forces", "words"),
    [
        ("30 g", {"friction": 0.7}, None),
        ("3 kg", {"friction": 0.7}, "phase 'lift': the joints are too weak: they hold 0.0"),
        ("30 g", {"friction": 1e-9}, "phase 'lift': these contacts cannot resist every load"),
    ],
)
def test_a_rehearsal_says_what_cannot_be_held_at_rest(
    mass: str, forces: dict[str, Any], words: str | None
) -> None:
    assembly = holding(mass=mass, forces=forces)
    before, _ = run(assembly, 5)
    found = rehearse(assembly.controller, assembly.start)
    told = [fault.text for fault in found.faults]
    assert [text[: len(words or "")] for text in told] == ([] if words is None else [words])
    assert found.stages[-1].load is not None
    assert (found.stages[-1].load[1] > 3.0) == (words is None)
    after, _ = run(assembly, 5)
    np.testing.assert_array_equal(plan(before[-1]).force, plan(after[-1]).force)


def test_a_sliding_contact_all_but_presses_along_its_normal() -> None:
    phases = [{**LIFT, "contacts": {"r_thumb": "fixed", "r_index": "fixed", "r_middle": "sliding"}}]
    assembly = holding(phases=phases, mass="20 g", forces={**SOFT, "sliding_friction": 0.02})
    records, _ = run(assembly, 5)
    for record in records:
        assert_good(record)
        force, inward = plan(record).force[2], -record.contact_normals[2]
        along = force @ inward
        assert along > 0.0
        assert np.linalg.norm(force - along * inward) <= 0.02 * along


def test_limits_by_pattern_are_kept() -> None:
    free, _ = run(holding(mass="50 g"), 3)
    tight = holding(mass="50 g", forces__torque_limits={"right_middle_*": "30 mNm"})
    records, _ = run(tight, 3)
    assert_good(records[-1])
    middle = [k for k, name in enumerate(tight.model.joint_names) if "right_middle" in name]
    assert np.abs(plan(free[-1]).torque[middle]).max() > 0.03
    assert np.abs(plan(records[-1]).torque[middle]).max() < 0.03


def test_sets_are_shared_contacts_by_what_they_can_carry() -> None:
    none, right = np.array([0, 0]), np.array([1, 0])
    both, slides, left = np.array([1, 1]), np.array([1, 2]), np.array([0, 1])
    modes = [none, right, slides, both, left, none]
    blank = np.zeros(2)
    phases = [
        Phase(str(k), m, blank, np.zeros((2, 3)), blank > 0, blank, borne=True)
        for k, m in enumerate(modes)
    ]
    sets, found = passages(phases)
    assert [s.tolist() for s in sets] == [[1, 0], [1, 2], [1, 1], [0, 1]]
    assert found == [
        Passage(-1, -1, -1), Passage(-1, 0, 0), Passage(0, 1, 1), Passage(1, 2, 3),
        Passage(3, 3, 3), Passage(-1, -1, -1),
    ]  # fmt: skip
    assert [way.ramps for way in found] == [0, 1, 1, 2, 0, 0]
    away = ObjectMotion(np.array([0.0, 0.0, 0.1]), np.eye(3), True)
    for change in ({"object_motion": away}, {"borne": False}):  # borne by fingers at once
        other = [*phases[:1], replace(phases[1], **change), *phases[2:]]  # type: ignore[arg-type]
        assert passages(other)[1][1] == Passage(0, 0, 0)


@pytest.mark.parametrize("over", [0.05, 0.4, 2.0])
def test_the_parts_of_the_sets_are_one_together_and_change_smoothly(over: float) -> None:
    way, times = Passage(0, 1, 2), np.linspace(-0.01, over + 0.1, 4001)
    parts = np.array([[way.weights(t, over, 0.2).get(k, 0.0) for k in range(3)] for t in times])
    np.testing.assert_allclose(parts.sum(axis=1), 1.0)
    assert parts[0].tolist() == [1.0, 0.0, 0.0] and parts[-1].tolist() == [0.0, 0.0, 1.0]
    ramp = min(0.2, 0.5 * over)
    assert np.abs(np.diff(parts, axis=0)).max() < 1.9 * (times[1] - times[0]) / ramp


def test_statics_from_a_log_and_from_a_tick_agree_in_the_world(held: Assembly) -> None:
    records, _ = run(held, 4)
    kin = held.controller.law.kin
    kin.update(records[-1].q, kin.state, kin.reference)
    one = touches(kin)
    n = kin.grasp.count
    normals = -one.frame[:, :, 2]
    points = kin.object_position + one.arm
    two = touches_at(points, normals, kin.robot.position[:n], kin.object_position)
    fingers, joints = np.arange(n), np.arange(held.model.nv)
    for i in range(n):
        assert np.linalg.det(one.frame[i]) == pytest.approx(1.0)
        assert np.linalg.det(two.frame[i]) == pytest.approx(1.0)
    np.testing.assert_allclose(one.pad, two.pad, atol=2e-5)
    (g, j), (g2, j2) = (statics(kin.robot, t, fingers, joints, False) for t in (one, two))
    for i in range(n):
        turn = one.frame[i].T @ two.frame[i]
        own = slice(3 * i, 3 * i + 3)
        np.testing.assert_allclose(g[:, own] @ turn, g2[:, own], atol=1e-12)
        np.testing.assert_allclose(turn.T @ j[own], j2[own], atol=2e-5)


@pytest.mark.slow
def test_the_exchange_is_planned_in_every_phase_with_contacts() -> None:
    """100 g by the ends of the bottle take stronger fingers than the hand has, for it tips: with
    its own, the largest mass is 9 g, and both hands together hold 160 g."""
    strong = {f"*_{finger}_*": "1 Nm" for finger in ("thumb", "index", "middle")}
    assembly = build(
        load(
            "dual_arm_exchange",
            {
                "simulation.step": "10 ms",
                "object.mass": "0.1 kg",
                "object.inertia": [7e-4, 7e-4, 3e-5],
                "forces": {"friction": 0.6, "torque_limits": strong},
            },
        )
    )
    records, state = run(assembly, assembly.ticks)
    assert state.phase.done
    for record in records:
        assert_good(record)
    total = np.array([plan(record).sum_normal for record in records])
    names = [phase.name for phase in assembly.controller.phases.phases]
    seen = [names[record.phase] for record in records]
    touching = seen.index("lift")
    assert (total[:touching] == 0.0).all() and (total[touching:] > 0.0).all()
    # in the middle both hands hold, each at its end: no one needs to clasp it against tipping
    assert total[seen.index("hand_over")] < 0.1 * total[seen.index("release")]
    forces = np.array([plan(record).force for record in records])
    steps = np.abs(np.diff(forces, axis=0)).max(axis=(1, 2))
    steps[touching - 1] = 0.0  # what carries it from the table is there at once
    assert steps.max() < 0.1 * np.linalg.norm(forces, axis=2).max()

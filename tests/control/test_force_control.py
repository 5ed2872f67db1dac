"""The second stage (36): its terms one by one, its limits, and what it does with bad numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from wbc import resources
from wbc.arrays import Array
from wbc.contact.grasp import ContactMode
from wbc.control.force_control import (
    ForceControl,
    ForceGains,
    Goal,
    TorqueState,
    TorqueStatus,
    internal_part,
)
from wbc.control.set_points import balanced
from wbc.control.state import Measurement
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel, load_robot

FREE, FIXED, SLIDING = ContactMode.FREE, ContactMode.FIXED, ContactMode.SLIDING
DT = 2e-3
TIPS = ("right_thumb_tip", "right_index_tip", "right_middle_tip")
ANGLES = np.radians([0.0, 120.0, 240.0])
NORMALS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(3)])
POINTS = 0.03 * NORMALS


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return load_robot(resources.find("urdf", "dual_arm"))


def gains(model: RobotModel, **changes: object) -> ForceGains:
    one, joints = np.ones(3), np.ones(model.nv)
    made = ForceGains(
        position=600.0 * one, force=0.5 * one, integral=5.0 * one, smoothing=0.0, windup=2.0 * one,
        damping=0.03 * joints, stiffness=0.0 * joints, joint_integral=0.0 * joints,
        joint_windup=5.0 * joints, tau_min=-1e3 * joints, tau_max=1e3 * joints, inertia=False,
    )  # fmt: skip
    return replace(made, **changes)


def situation(model: RobotModel, **changes: object) -> tuple[Goal, Measurement]:
    """Three fingers hold with 2 N each, as planned, the robot at rest where it should be."""
    q = 0.5 * (model.lower + model.upper) + 0.1 * np.random.default_rng(5).normal(size=model.nv)
    force = -2.0 * NORMALS
    mode = np.full(3, FIXED, dtype=np.int64)
    goal = Goal(q, np.zeros(model.nv), mode, POINTS, NORMALS, force)
    return goal._replace(**changes), Measurement(q, np.zeros(model.nv), force.copy())


def settled(control: ForceControl, goal: Goal) -> TorqueState:
    """A state whose reference has stood where the goal has it."""
    state = control.init()
    return state._replace(track=state.track.then(goal.q, goal.v, DT).then(goal.q, goal.v, DT))


def tips(model: RobotModel, q: Array) -> Kinematics:
    return Kinematics(model, TIPS).update(q)


def own(model: RobotModel) -> Array:
    """(nv,) joints of the fingers, found by their names."""
    of_arm = ("torso", "right_arm", "left_arm")
    return np.array([not name.startswith(of_arm) for name in model.joint_names])


def gravity(model: RobotModel, q: Array) -> Array:
    """(nv,) by Pinocchio alone; the joints that follow others included by virtual work."""
    data = model.pin_model.createData()
    tau = np.zeros(model.nv)
    full = pin.computeGeneralizedGravity(model.pin_model, data, model.full(q))
    np.add.at(tau, model.master, model.ratio * full)
    return tau


def test_at_the_goal_it_gives_gravity_and_the_planned_forces(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    command, _ = control.step(settled(control, goal), goal, measured, DT)
    planned = np.einsum("irj,ir->j", tips(model, goal.q).linear, goal.force)
    assert command.tau == pytest.approx(gravity(model, goal.q) + planned, abs=1e-10)
    assert command.status == TorqueStatus.OK


def test_the_weight_reaches_the_arm_through_the_hand(model: RobotModel) -> None:
    goal, measured = situation(model)
    lifted = goal._replace(force=goal.force + np.array([0.0, 0.0, 1.0]))
    control = ForceControl(model, TIPS, gains(model, force=np.zeros(3), integral=np.zeros(3)))
    low, _ = control.step(settled(control, goal), goal, measured, DT)
    high, _ = control.step(settled(control, goal), lifted, measured, DT)
    lift = tips(model, goal.q).linear[:, 2].sum(axis=0)
    assert high.tau - low.tau == pytest.approx(lift, abs=1e-10)
    assert np.abs(lift[~own(model)]).max() > 0.1


def test_position_errors_are_of_the_tip_relative_to_the_palm(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    fingers, rest = own(model), settled(control, goal)
    before, _ = control.step(rest, goal, measured, DT)
    step = 1e-4 * np.random.default_rng(6).normal(size=model.nv)
    arm = measured._replace(q=np.where(fingers, goal.q, goal.q + step))
    kin = tips(model, arm.q)
    expected = gravity(model, arm.q) + np.einsum("irj,ir->j", kin.linear, goal.force)
    after, _ = control.step(rest, goal, arm, DT)
    assert after.tau == pytest.approx(expected, abs=1e-10)  # an arm's error moves no finger
    bent = measured._replace(q=np.where(fingers, goal.q + step, goal.q))
    kin = tips(model, bent.q)
    reach = tips(model, goal.q).position.copy() - Kinematics(model, TIPS).update(bent.q).position
    push = goal.force + 600.0 * reach
    expected = np.einsum("irj,ir->j", kin.linear, push) + gravity(model, bent.q)
    after, _ = control.step(rest, goal, bent, DT)
    assert after.tau[fingers] == pytest.approx(expected[fingers], abs=1e-9)
    assert before.status == after.status == TorqueStatus.OK


def test_position_errors_in_the_world_let_fingers_make_up_for_their_arm(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model, relative=False))
    fingers, rest = own(model), settled(control, goal)
    sagged = measured._replace(q=np.where(fingers, goal.q, goal.q + 1e-3))
    wanted = tips(model, goal.q).position.copy()
    kin = tips(model, sagged.q)
    push = goal.force + 600.0 * (wanted - kin.position)
    expected = np.einsum("irj,ir->j", kin.linear, push) + gravity(model, sagged.q)
    command, _ = control.step(rest, goal, sagged, DT)
    assert np.linalg.norm(wanted - kin.position, axis=1).min() > 5e-4
    assert command.tau[fingers] == pytest.approx(expected[fingers], abs=1e-9)
    low = np.einsum("irj,ir->j", kin.linear, goal.force) + gravity(model, sagged.q)
    assert command.tau[~fingers] == pytest.approx(low[~fingers], abs=1e-9)  # arms by their joints


def test_internal_force_errors_are_acted_on_and_others_are_not(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    rest = settled(control, goal)
    base, _ = control.step(rest, goal, measured, DT)
    linear = tips(model, goal.q).linear * own(model)
    weak = measured._replace(force=0.9 * goal.force)  # all three press 0.2 N too little: internal
    command, state = control.step(rest, goal, weak, DT)
    assert command.error == pytest.approx([0.2, 0.2, 0.2])
    assert state.integral == pytest.approx(5.0 * DT * np.full(3, 0.2), rel=1e-2)
    press = 0.5 * 0.2 + state.integral
    added = np.einsum("irj,ir->j", linear, -press[:, None] * NORMALS)
    assert command.tau - base.tau == pytest.approx(added, rel=1e-2, abs=1e-9)
    uneven = goal.force - 0.2 * np.array([[1.0], [-0.5], [-0.5]]) * NORMALS  # moves the object
    command, state = control.step(rest, goal, measured._replace(force=uneven), DT)
    assert np.abs(command.error).max() == pytest.approx(0.2)
    assert np.abs(state.integral).max() < 0.02 * 5.0 * DT * 0.2


def test_the_internal_part_is_smooth_and_sliding_tips_stand_for_themselves() -> None:
    mode = np.array([FIXED, FIXED, SLIDING])
    normals = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    points = np.array([[0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.5, 0.0, 0.0]])
    part = internal_part(normals, points, mode)
    assert part[:2, :2] @ [1.0, 1.0] == pytest.approx([1.0, 1.0])
    assert np.abs(part[:2, :2] @ [1.0, -1.0]).max() < 2e-3
    assert part[2] == pytest.approx([0.0, 0.0, 1.0])
    assert not internal_part(normals, points, np.array([FREE, FREE, FREE])).any()
    last = part
    for turn in np.linspace(0.0, 0.5, 501):  # the grasp line bends: internal forces fade, no step
        normals[1] = [np.sin(turn), -np.cos(turn), 0.0]
        part = internal_part(normals, points, mode)
        assert np.abs(part - last).max() < 2e-2
        last = part
    assert np.linalg.norm(last[:2, :2] @ [1.0, 1.0]) < 0.1


def test_smoothed_errors_come_up_at_their_time_constant(model: RobotModel) -> None:
    goal, measured = situation(model)
    quick = gains(model, integral=np.zeros(3))
    slow = replace(quick, smoothing=0.01)
    weak = measured._replace(force=0.9 * goal.force)
    whole, _ = ForceControl(model, TIPS, quick).step(
        settled(ForceControl(model, TIPS, quick), goal), goal, weak, DT
    )
    control = ForceControl(model, TIPS, slow)
    state = settled(control, goal)
    base, _ = control.step(state, goal, measured, DT)
    for k in range(1, 11):
        command, state = control.step(state, goal, weak, DT)
        share = 1.0 - np.exp(-k * DT / 0.01)
        expected = share * (whole.tau - base.tau)
        assert command.tau - base.tau == pytest.approx(expected, abs=1e-9)


def test_the_integrator_stops_at_its_bound_and_comes_back(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    state = settled(control, goal)
    for _ in range(3000):
        command, state = control.step(state, goal, measured._replace(force=0.0 * goal.force), DT)
        assert np.abs(state.integral).max() <= 2.0
    assert command.status == TorqueStatus.INTEGRAL_LIMIT
    strong = measured._replace(force=1.5 * goal.force)
    for _ in range(100):
        before = state.integral
        command, state = control.step(state, goal, strong, DT)
        assert (state.integral < before).all()  # no wound-up surplus to work off first
    free = goal._replace(mode=np.array([FREE, FIXED, FIXED]))
    _, state = control.step(state, free, strong, DT)
    assert state.integral[0] == 0.0 and state.integral[1] != 0.0


def test_torques_keep_their_limits_and_integrators_wait_meanwhile(model: RobotModel) -> None:
    goal, measured = situation(model)
    tight = gains(model, tau_min=np.full(model.nv, -0.01), tau_max=np.full(model.nv, 0.01))
    control = ForceControl(model, TIPS, tight)
    weak = measured._replace(force=0.5 * goal.force)
    state = settled(control, goal)
    for _ in range(20):
        command, state = control.step(state, goal, weak, DT)
    assert (np.abs(command.tau) <= 0.01).all()
    assert command.status & TorqueStatus.SATURATED
    assert not state.integral.any()


def test_integrators_unwind_at_a_limit_that_they_help_to_exceed(model: RobotModel) -> None:
    """Fingers press too hard, at their limits: what has been integrated goes, though they wait."""
    goal, measured = situation(model)
    strong = measured._replace(force=1.5 * goal.force, q=goal.q - 0.01 * ~own(model))
    arms = np.where(own(model), 0.0, 20.0)
    free = ForceControl(model, TIPS, gains(model, joint_integral=arms, stiffness=50.0 * (arms > 0)))
    full = settled(free, goal)._replace(integral=np.full(3, 1.5))
    asked, _ = free.step(full, goal, strong, DT)
    tight = replace(free.gains, tau_min=-0.98 * abs(asked.tau), tau_max=0.98 * abs(asked.tau))
    control = ForceControl(model, TIPS, tight)
    state, high = full, asked.tau > 0.0
    for _ in range(50):
        command, state = control.step(state, goal, strong, DT)
        assert command.status & TorqueStatus.SATURATED
    assert (state.integral < 1.45).all()
    held = state.joint_integral[~own(model) & high]
    assert (held == 0.0).all() and (state.joint_integral >= 0.0).all()
    assert state.joint_integral[~own(model) & ~high].max() > 0.0  # these take from the torque


def test_arms_are_held_by_their_joints_with_integral_action(model: RobotModel) -> None:
    goal, measured = situation(model)
    arm = ~own(model)
    given = gains(
        model, stiffness=np.where(arm, 50.0, 0.0), joint_integral=np.where(arm, 20.0, 0.0)
    )
    control = ForceControl(model, TIPS, given)
    base, _ = control.step(settled(control, goal), goal, measured, DT)
    moving = measured._replace(v=np.where(arm, 0.1, 0.0))
    braked, _ = control.step(settled(control, goal), goal, moving, DT)
    assert (braked.tau - base.tau)[arm] == pytest.approx(-0.003, abs=1e-12)
    off = measured._replace(q=goal.q - 0.01 * arm)
    state = settled(control, goal)
    first, state = control.step(state, goal, off, DT)
    for _ in range(99):
        command, state = control.step(state, goal, off, DT)
    growth = (command.tau - first.tau)[arm]
    assert growth == pytest.approx(20.0 * 0.01 * 99 * DT, rel=1e-9)


def test_a_moving_reference_is_followed_without_delay(model: RobotModel) -> None:
    """From a staircase of velocities the motion behind it: q, v, and a half a tick ahead."""
    goal, _ = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    state, q = control.init(), np.zeros(model.nv)
    _, measured = situation(model)
    for k in range(6):  # q = t³/6: v = t²/2, a = t
        t = k * DT
        q = np.full(model.nv, t**3 / 6.0)
        ahead = np.full(model.nv, (t + DT) ** 3 / 6.0)
        _, state = control.step(state, goal._replace(q=q, v=(ahead - q) / DT), measured, DT)
    track, t = state.track, 5 * DT
    assert track.v == pytest.approx(0.5 * t**2, abs=DT**2 / 2)
    assert track.a == pytest.approx(t + 0.5 * DT, abs=1e-9)
    later = track.at(DT)
    assert later.v == pytest.approx(0.5 * (t + DT) ** 2, abs=DT**2 / 2)


BAD = {
    "no velocity": {"v": None},
    "no force": {"force": None},
    "NaN position": {"q": np.nan},
    "infinite velocity": {"v": np.inf},
    "NaN force": {"force": np.nan},
    "short": {"q": "short"},
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_no_measurement_holds_the_last_torques(model: RobotModel, what: str) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    good, state = control.step(settled(control, goal), goal, measured, DT)
    changed = {}
    for name, value in BAD[what].items():
        old = getattr(measured, name)
        if value == "short":
            changed[name] = old[:-1]
        elif value is None:
            changed[name] = None
        else:
            changed[name] = old.copy()
            changed[name].flat[1] = value
    command, after = control.step(state, goal, measured._replace(**changed), DT)
    assert command.status == TorqueStatus.BAD_MEASUREMENT
    assert np.array_equal(command.tau, good.tau)
    assert np.array_equal(after.integral, state.integral)
    again, _ = control.step(after, goal, measured, DT)
    assert again.status == TorqueStatus.OK and np.isfinite(again.tau).all()


def test_a_goal_that_is_no_number_holds_the_last_torques(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    good, state = control.step(settled(control, goal), goal, measured, DT)
    for bad in (
        goal._replace(q=np.full(model.nv, np.nan)),
        goal._replace(v=np.full(model.nv, np.inf)),
        goal._replace(force=np.full((3, 3), np.nan)),
        goal._replace(normals=np.full((3, 3), np.nan)),
        goal._replace(force=np.full((3, 3), 1e308)),
        goal._replace(v=np.full(model.nv, 1e308)),
    ):
        command, after = control.step(state, bad, measured, DT)
        assert command.status == TorqueStatus.BAD_COMMAND
        assert np.array_equal(command.tau, good.tau)
        assert np.isfinite(after.integral).all()
        again, _ = control.step(after, goal, measured, DT)
        assert np.isfinite(again.tau).all()
        assert again.status == TorqueStatus.OK


def test_a_step_is_a_pure_function(model: RobotModel) -> None:
    goal, measured = situation(model)
    control = ForceControl(model, TIPS, gains(model))
    state = settled(control, goal)
    weak = measured._replace(force=0.9 * goal.force)
    first, after = control.step(state, goal, weak, DT)
    control.step(after, goal, measured._replace(q=goal.q + 0.1), DT)
    second, again = control.step(state, goal, weak, DT)
    assert np.array_equal(first.tau, second.tau)
    assert np.array_equal(after.integral, again.integral)


def test_set_points_balance_and_stay_near_what_was_asked_for() -> None:
    press = np.array([2.0, 2.0, 2.0])
    mode = np.full(3, FIXED)
    alone = balanced(press, mode, POINTS, NORMALS, np.zeros(6), False)
    assert alone == pytest.approx(-2.0 * NORMALS)  # they balance already
    wrench = np.array([0.1, -0.2, 0.98, 0.001, 0.002, -0.001])
    force = balanced(press, mode, POINTS, NORMALS, wrench, False)
    assert force.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-12)
    assert np.cross(POINTS, force).sum(axis=0) == pytest.approx(wrench[3:], abs=1e-12)


def test_what_sliding_tips_press_is_borne_by_those_that_hold() -> None:
    normals = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    points = np.array([[0.0, 0.3, 0.0], [0.0, -0.3, 0.0], [0.5, 0.1, 0.0]])
    mode = np.array([FIXED, FIXED, SLIDING])
    force = balanced(np.array([20.0, 20.0, 1.0]), mode, points, normals, np.zeros(6), True)
    assert force[2] == pytest.approx([-1.0, 0.0, 0.0])  # it can but press
    assert force.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.cross(points, force).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert force[0, 1] == pytest.approx(-20.0, abs=0.2)
    gone = balanced(np.array([20.0, 0.0, 1.0]), mode, points, normals, np.zeros(6), True)
    assert not gone[1].any()  # one that is about to leave is asked for nothing
    none = balanced(np.zeros(3), np.full(3, FREE), points, normals, np.ones(6), True)
    assert not none.any()

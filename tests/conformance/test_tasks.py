"""The laws of every task, over the table of all of them."""

from __future__ import annotations

from dataclasses import is_dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import wbc.tasks
from conformance.discovery import concrete, snapshot
from conformance.robots import SETTINGS
from conformance.task_table import (
    TASKS,
    Example,
    TaskCase,
    balanced,
    frame_orientation,
    frame_pose,
)
from conformance.worlds import (
    DEFAULT_SURFACE,
    FIXED,
    FREE,
    PLACES,
    ROBOT_SURFACES,
    SLIDING,
    World,
    central_difference,
    make_world,
    moved,
    random_rotation,
    scaled,
    seeded,
    unpacked,
    without_object,
)
from wbc.contact.grasp import ContactMode, equilibrium_residuals
from wbc.rotations import exp_so3
from wbc.tasks import EquilibriumForce, EquilibriumMoment, Task, TaskRows, empty_rows
from wbc.tasks.base import fade

CONTACTS = {
    "free": {"planar": (FREE,) * 4, "hand": (FREE,) * 2},
    "fixed": {"planar": (FIXED, FIXED, FREE, FREE), "hand": (FIXED, FIXED)},
    "sliding": {"planar": (SLIDING,) * 4, "hand": (SLIDING, SLIDING)},
    "mixed": {"planar": (FIXED, FIXED, SLIDING, SLIDING), "hand": (FIXED, SLIDING)},
}
for _modes in CONTACTS.values():
    _modes["coupled"] = _modes["hand"]
SEEDS = range(2)


def rows_of_table(  # type: ignore[no-untyped-def]
    *, contacts: tuple[str, ...] = ("free",), spots: str = "spots", places: tuple[str, ...] = PLACES
):
    """pytest parameters: case, robot, surface, place, spot, contacts; with readable ids."""
    out = []
    for kind, cases in TASKS.items():
        for n, case in enumerate(cases):
            pairs = ROBOT_SURFACES if case.surfaces else list(DEFAULT_SURFACE.items())
            for robot, surface in pairs:
                for place in (p for p in case.places if p in places):
                    for spot in getattr(case, spots):
                        for contact in contacts if case.surfaces else contacts[:1]:
                            words = [kind.__name__ + str(n), robot, surface, place, spot, contact]
                            out.append(
                                pytest.param(
                                    case, robot, surface, place, spot, contact, id="-".join(words)
                                )
                            )
    return pytest.mark.parametrize(("case", "robot", "surface", "place", "spot", "contact"), out)


def example_of(  # type: ignore[no-untyped-def]
    case: TaskCase, robot, surface, place, spot, contact, *, seed=0, **world
) -> Example:
    modes = CONTACTS[contact][robot]
    base = make_world(robot, surface, modes, place, seed=(seed, spot), **world)
    return case.make(base, seeded(robot, surface, place, spot, seed), spot)


def evaluate(example: Example, world: World | None = None, target=None) -> TaskRows:  # type: ignore[no-untyped-def]
    """The rows of an example, in its own world or another one."""
    world = world or example.world
    out = empty_rows(example.task.rows, world.columns)
    example.task.evaluate(world.update(), example.target if target is None else target, out)
    return out


def check_derivative(got: np.ndarray, want: np.ndarray) -> None:
    """Equal to the accuracy of the differences; absolute up to 1, relative above."""
    assert np.all(np.isfinite(got))
    assert np.abs(got - want).max(initial=0.0) < 2e-8 * max(1.0, np.abs(want).max(initial=0.0))


def test_every_task_class_is_in_the_table() -> None:
    assert concrete(Task, wbc.tasks) == set(TASKS)


@pytest.mark.parametrize("kind", TASKS, ids=lambda kind: kind.__name__)
def test_task_classes_are_final_frozen_and_exported(kind: type[Task]) -> None:
    assert getattr(kind, "__final__", True) is True and not kind.__subclasses__()
    assert is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    assert kind.__name__ in wbc.tasks.__all__


@rows_of_table()
def test_jacobian_is_minus_the_derivative_of_the_error(  # type: ignore[no-untyped-def]
    case, robot, surface, place, spot, contact
) -> None:
    """J = ∂σ/∂q̃ over [q, ξ], the object at rest where its reference has it."""
    for seed in SEEDS:
        example = example_of(case, robot, surface, place, spot, contact, seed=seed)
        world = example.world
        got = evaluate(example).jacobian
        if case.silent:
            assert evaluate(example).activation.max() > 0.0
        for k, e in enumerate(np.eye(world.columns)):
            want = -central_difference(
                lambda t, w=world, x=example, e=e: evaluate(x, w.at(w.q_ext + t * e)).error,
                case.step,
            )
            check_derivative(got[:, k], want)


@rows_of_table(contacts=("fixed", "sliding", "mixed"))
def test_jacobian_along_motions_that_leave_the_object_in_the_fingers_at_rest(  # type: ignore[no-untyped-def]
    case, robot, surface, place, spot, contact
) -> None:
    """In contact the object is where the fingers have it: J holds in the main task's null space."""
    example = example_of(case, robot, surface, place, spot, contact)
    world, rng = example.world, seeded(robot, surface, place, spot, contact)
    kin, n = world.update(), world.grasp.count
    rows = kin.rows[: kin.row_count].copy()
    v = rng.normal(size=world.nv)
    v -= np.linalg.pinv(rows, rcond=1e-9) @ (rows @ v)
    _, xi, theta = unpacked(np.subtract(*kin.extend(0.0 * v, v)[::-1]), n)
    speed = max(1.0, np.abs(xi).max(), np.abs(theta).max())
    q_dot = np.concatenate([v, xi.ravel()]) / speed

    def after(t: float) -> np.ndarray:
        turned = np.stack([exp_so3(t * w / speed) for w in theta]) @ world.state.pivot
        there = world.at(world.q_ext + t * q_dot)
        there = replace(there, state=there.state._replace(pivot=turned))
        return evaluate(example, there).error

    check_derivative(evaluate(example).jacobian @ q_dot, -central_difference(after, case.step))


@rows_of_table()
def test_feed_forward_is_the_derivative_of_the_error_in_time(  # type: ignore[no-untyped-def]
    case, robot, surface, place, spot, contact
) -> None:
    """With the joints at rest, ė = σ̇_d − ∂σ/∂t as the target and the object's reference move on."""
    example = example_of(case, robot, surface, place, spot, contact)
    world = example.world
    reference = world.reference

    def later(t: float) -> np.ndarray:
        twist = reference.twist
        there = reference._replace(
            position=reference.position + t * twist[:3],
            rotation=exp_so3(t * twist[3:]) @ reference.rotation,
        )
        target = case.advance(example.target, t) if example.target is not None else None
        return evaluate(example, replace(world, reference=there), target).error

    check_derivative(evaluate(example).rate, central_difference(later))


@rows_of_table(contacts=("free", "mixed"))
def test_rows_go_with_the_world(case, robot, surface, place, spot, contact) -> None:  # type: ignore[no-untyped-def]
    """Robot, object and target carried by one rigid motion: the same rows, turned with it."""
    example = example_of(case, robot, surface, place, spot, contact)
    motion = SETTINGS[robot].motion
    target, turn = case.move(example.task, example.target, motion.rotation, motion.translation)
    here = evaluate(example)
    there = evaluate(example, moved(example.world, motion), target)
    size = max(1.0, np.abs(here.jacobian).max())
    assert_allclose(there.error, turn @ here.error, atol=1e-9)
    assert_allclose(there.jacobian, turn @ here.jacobian, atol=1e-8 * size)
    assert_allclose(there.rate, turn @ here.rate, atol=1e-8 * size)
    assert_allclose(there.activation, here.activation, atol=1e-8)


@rows_of_table(contacts=("free", "mixed"), places=("random",))
def test_rows_are_in_their_units(case, robot, surface, place, spot, contact) -> None:  # type: ignore[no-untyped-def]
    """All lengths times 2: rows in m^k go with 2^k, and angles stay."""
    example = example_of(case, robot, surface, place, spot, contact, prismatic=False)
    base = make_world(
        robot, surface, CONTACTS[contact][robot], place, seed=(0, spot), prismatic=False
    )
    large = case.make(scaled(base, surface, 2.0), seeded(robot, surface, place, spot, 0), spot)
    target = case.stretch(example.target, 2.0) if example.target is not None else None
    factor = 2.0 ** np.array(case.lengths(example.task))
    here, there = evaluate(example), evaluate(large, target=target)
    assert_allclose(there.error, factor * here.error, rtol=1e-6, atol=1e-7)
    assert_allclose(there.rate, factor * here.rate, rtol=1e-6, atol=1e-7)
    assert_allclose(there.activation, here.activation, atol=1e-6)
    nv = base.nv
    assert_allclose(
        there.jacobian[:, :nv], factor[:, None] * here.jacobian[:, :nv], rtol=1e-6, atol=1e-7
    )


@rows_of_table(contacts=("free", "mixed"))
def test_evaluation_is_pure_and_keeps_to_its_rows(  # type: ignore[no-untyped-def]
    case, robot, surface, place, spot, contact
) -> None:
    example = example_of(case, robot, surface, place, spot, contact)
    world, task = example.world, example.task
    kin, m, columns = world.update(), task.rows, world.columns
    assert task.target is None or np.array_equal(task.target, example.target)
    before = snapshot(kin, example.target, task)
    first = empty_rows(m, columns)
    task.evaluate(kin, example.target, first)
    # in the middle of a stack's arrays, and a second time
    error, jacobian = np.full(m + 2, 7.0), np.full((m + 2, columns), 7.0)
    rate, activation = np.full(m + 2, 7.0), np.full(m + 2, 7.0)
    second = TaskRows(error[1:-1], jacobian[1:-1], rate[1:-1], activation[1:-1])
    second.error[:], second.jacobian[:], second.rate[:], second.activation[:] = 0, 0, 0, 1
    task.evaluate(kin, example.target, second)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a, b) and np.all(np.isfinite(a))
    for array in (error, jacobian, rate, activation):
        assert np.all(array[0] == 7.0) and np.all(array[-1] == 7.0)
    assert np.all((first.activation >= 0.0) & (first.activation <= 1.0))
    for a, b in zip(before, snapshot(kin, example.target, task), strict=True):
        assert np.array_equal(a, b, equal_nan=True)


@rows_of_table(spots="silent")
def test_rows_out_of_force_are_empty(case, robot, surface, place, spot, contact) -> None:  # type: ignore[no-untyped-def]
    out = evaluate(example_of(case, robot, surface, place, spot, contact))
    assert not out.activation.any() and not out.error.any() and not out.jacobian.any()


@pytest.mark.parametrize("robot", SETTINGS)
@pytest.mark.parametrize("make", [frame_pose, frame_orientation])
@pytest.mark.parametrize("seed", range(20))
def test_orientation_rows_are_finite_and_bounded_at_half_a_turn(robot, make, seed) -> None:  # type: ignore[no-untyped-def]
    world = make_world(robot, seed=seed)
    example = make(world, seeded(robot, seed), "turn")
    out = evaluate(example)
    turning = out.error[2:] if robot == "planar" else out.error[-3:]
    if make is frame_orientation:
        turning = out.error
    assert np.linalg.norm(turning) == pytest.approx(np.pi, abs=1e-7)
    assert np.all(np.isfinite(out.jacobian)) and np.abs(out.jacobian).max() < 20.0
    assert np.all(np.isfinite(out.rate))


@pytest.mark.parametrize("robot", SETTINGS)
def test_orientation_error_is_the_missing_rotation(robot: str) -> None:
    """Turning by e, in the axes of its rows, brings the frame to the reference."""
    for seed in range(10):
        world = make_world(robot, seed=seed)
        example = frame_orientation(world, seeded(seed), "far")
        e = evaluate(example).error
        turn = exp_so3(np.array([0.0, 0.0, e[0]]) if len(e) == 1 else e)
        here = world.kin.robot.rotation[example.task.frame]  # type: ignore[attr-defined]
        assert_allclose(turn @ here, example.target[:9].reshape(3, 3), atol=1e-12)  # type: ignore[index]


@pytest.mark.parametrize(("robot", "surface"), ROBOT_SURFACES)
def test_equilibrium_at_the_goal(robot: str, surface: str) -> None:
    """At the balance the error is zero, and |σ| still grows at |J| along J: nothing stalls."""
    for seed in range(4):
        world = balanced(make_world(robot, surface, seed=seed), seeded(seed), 0.0)
        for kind in (EquilibriumForce, EquilibriumMoment):
            example = Example(world, kind("balance", 1.0, 1.0), None)
            out = evaluate(example)
            assert abs(out.error[0]) < 1e-7
            assert np.all(np.isfinite(out.jacobian))
            way = out.jacobian[0] / max(np.linalg.norm(out.jacobian), 1e-300)
            step = 1e-5
            grown = [abs(evaluate(example, world.at(world.q_ext + s * step * way)).error[0])
                     for s in (-1, 1)]  # fmt: skip
            assert_allclose(grown, step * np.linalg.norm(out.jacobian), rtol=0.05, atol=1e-7)


def test_a_thumb_opposes_two_fingers() -> None:
    """Three fingers on one side of a circle, the thumb pressing as hard as they do together."""
    world, spread = make_world("planar", "circle", ContactMode.SLIDING), 0.4
    xi = np.array([[0.0, 0.0], [spread, 0.0], [-spread, 0.0], [np.pi, 0.0]])
    world = replace(world, state=world.state._replace(xi=xi))
    unit = world.with_shares(np.ones(4))
    thumb = world.with_shares(np.array([1.0, 1.0, 1.0, 1.0 + 2.0 * np.cos(spread)]))
    for kind in (EquilibriumForce, EquilibriumMoment):
        task = kind("balance", 1.0, 1.0)
        assert abs(evaluate(Example(thumb, task, None)).error[0]) < 1e-15
    assert evaluate(Example(unit, EquilibriumForce("balance", 1.0, 1.0), None)).error[0] < -1.0
    kin = thumb.update()
    points, normals = kin.charts[:, 0], kin.frame[:, :, 2]
    assert max(equilibrium_residuals(points, normals, thumb.grasp.share)) < 1e-30
    off = seeded("thumb").uniform(0.3, 2.0, 4)
    f = (off[:, None] * normals).sum(axis=0)
    m = np.cross(points, off[:, None] * normals).sum(axis=0)
    found = equilibrium_residuals(points, normals, off)
    assert_allclose(found, (0.5 * f @ f, 0.5 * m @ m), rtol=1e-14)


@pytest.mark.parametrize("robot", SETTINGS)
def test_tasks_of_the_robot_alone_need_no_object(robot: str) -> None:
    for cases in TASKS.values():
        for case in cases:
            if case.surfaces or "goal" not in case.spots:
                continue
            bare = without_object(robot)
            example = case.make(bare, seeded(robot, "alone"), "far")
            out = evaluate(example)
            assert out.jacobian.shape == (example.task.rows, bare.nv) and out.error.any()
            step = central_difference(
                lambda t, x=example, w=bare: evaluate(x, w.at(w.q_ext + t)).error
            )
            check_derivative(out.jacobian.sum(axis=1), -step)


def test_targets_without_feed_forward_are_taken_too() -> None:
    """The short form of a target is the long one at rest."""
    for kind, cases in TASKS.items():
        example = example_of(cases[0], "hand", "spheroid", "random", cases[0].spots[-1], "free")
        short = {"FramePose": 12, "RelativePose": 12, "FrameOrientation": 9, "FramePosition": 3,
                 "CenterOfMass": 3, "Posture": 4, "Synergy": 2}.get(kind.__name__)  # fmt: skip
        if short is None or example.target is None:
            continue
        a, b = evaluate(example), evaluate(example, target=example.target[:short].copy())
        assert np.array_equal(a.error, b.error) and np.array_equal(a.jacobian, b.jacobian)
        assert a.rate.any() and not b.rate.any()


def test_fade_is_a_smooth_step() -> None:
    x = np.linspace(-0.5, 1.5, 401) * 0.05
    y = np.array([fade(depth, 0.05) for depth in x])
    assert np.all(np.diff(y) >= 0.0) and np.all(y[x <= 0] == 0.0) and np.all(y[x >= 0.05] == 1.0)
    slope = np.gradient(y, x)
    assert np.abs(np.diff(slope)).max() < 1.0  # no step in the slope, which reaches 1.5 / 0.05
    assert fade(float("nan"), 0.05) == 0.0


def test_random_rotations_of_the_plane_turn_about_z() -> None:
    assert np.allclose(random_rotation(seeded(0), True)[2], [0, 0, 1])


def test_contact_types_of_the_table_cover_all() -> None:
    assert {m for c in CONTACTS.values() for modes in c.values() for m in modes} == set(ContactMode)

"""The exchange from its reference start: every figure that it must show."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.control.state import Status

from .runs import Run, check_laws, equilibrium, finger_distance, link_distances

# What an earlier prototype reached from its own reference start; each is to be beaten.
PROTOTYPE_OBJECT_ERROR = 5e-10  # [m], 2 ms Runge-Kutta, after 0.3 s
PROTOTYPE_EPS = 2e-9
PROTOTYPE_DISTANCE = 0.39  # [m], between fingers
PROTOTYPE_STEP = 0.008  # [rad/s] per tick, where a task is switched
AFTER = 3  # ticks looked at from a switch on


def steps_at_events(run: Run) -> list[float]:
    """Largest velocity step of the ticks from each event on, [rad/s]."""
    return [float(run.velocity_steps[k : k + AFTER].max()) for k, _, _ in run.events]


def test_every_law_is_kept(reference: Run) -> None:
    check_laws(reference)


def test_nothing_gives_way(reference: Run) -> None:
    assert reference.status == Status.DONE
    assert reference.state.phase.done and not reference.state.phase.timeouts


def test_residuals_vanish_by_three_seconds_and_stay(reference: Run) -> None:
    eps = reference.series("residuals").max(axis=1)
    due = reference.t >= 3.3 - 1e-9
    assert eps[due].max() < 1e-6
    assert eps[-1] < PROTOTYPE_EPS
    since = reference.t[np.flatnonzero(eps >= 1e-6)[-1] + 1]
    print(f"eps below 1e-6 from {since:.3f} s on, at the end {eps[-1]:.2g}")


def test_the_receiving_hand_alone_holds_what_the_giving_one_held_alone(reference: Run) -> None:
    """The published residuals sum over four fingers; an exchange needs each pair to balance."""
    before = equilibrium(reference, ["f1", "f2"])[0].max()
    after = equilibrium(reference, ["f3", "f4"])[-1].max()
    assert before < 1e-20 and after < PROTOTYPE_EPS
    print(f"fingers 1, 2 at the start {before:.1g}; fingers 3, 4 at the end {after:.2g}")


def test_the_logged_residuals_are_those_of_the_points_in_the_world(reference: Run) -> None:
    independent = equilibrium(reference, ["f1", "f2", "f3", "f4"])
    np.testing.assert_allclose(independent, reference.series("residuals"), atol=1e-12)


def test_the_object_is_held_to_a_fraction_of_a_nanometre(reference: Run) -> None:
    """After 0.3 s, through the hand-over and while fingers 1, 2 leave."""
    late = reference.t > 0.3
    assert reference.object_error[late].max() < PROTOTYPE_OBJECT_ERROR
    turned = np.nanmax(reference.series("object_error")[late][:, :, 1])
    assert turned < 1e-9
    still = reference.t < reference.phase_start("carry")
    moved = reference.series("object_position") - reference.series("object_position")[0]
    assert np.abs(moved[still]).max() < 1e-9
    np.testing.assert_allclose(moved[-1], [0.08, -0.1, 0.0], atol=1e-9)
    print(f"object error {reference.object_error[late].max():.2g} m, {turned:.2g} rad")


def test_fingers_keep_apart(reference: Run) -> None:
    """By capsules placed and measured here, over all links, watched or not."""
    apart = finger_distance(reference).min()
    assert apart >= 0.15
    assert apart > PROTOTYPE_DISTANCE
    everything = min(d.min() for d in link_distances(reference).values())
    assert everything >= 0.15
    print(f"fingers {apart:.4f} m apart; any two links {everything:.4f} m")


def test_links_keep_off_the_object(reference: Run) -> None:
    assert reference.series("min_distance").min() > 0.15


def test_joints_keep_within_the_soft_range(reference: Run) -> None:
    largest = np.rad2deg(np.abs(reference.q).max())
    assert largest < 115.0
    print(f"largest joint angle {largest:.2f} deg")


def test_a_task_leaves_and_returns(reference: Run) -> None:
    out = {name for _, name, inserted in reference.events if not inserted}
    back = {name for _, name, inserted in reference.events if inserted}
    assert out and out == back
    assert len(reference.events) <= 12
    assert reference.state.stack.allowed.all()
    assert reference.events[0][2] is False and reference.events[-1][2] is True
    print([(f"{reference.t[k]:.3f} s", name, inserted) for k, name, inserted in reference.events])


def test_tasks_switch_smoothly(reference: Run, unsmoothed: Run) -> None:
    smooth, abrupt = steps_at_events(reference), steps_at_events(unsmoothed)
    assert max(smooth) <= 0.03
    assert max(smooth) <= 0.1 * min(abrupt)
    assert reference.velocity_steps.max() <= 0.03  # nor anywhere else
    print(f"velocity step {np.round(smooth, 4)} rad/s, unsmoothed {np.round(abrupt, 3)},", end="")
    print(f" in the whole run {reference.velocity_steps.max():.4f}")


def test_fades_are_smooth_to_their_end(reference: Run) -> None:
    """A gain moves fastest 1/mu after its switch, not at it: look at the whole fade, 5/mu."""
    fades = [float(reference.velocity_steps[k : k + 125].max()) for k, _, _ in reference.events]
    print(f"largest velocity step in the 0.25 s after a switch {np.round(fades, 4)} rad/s")
    assert max(fades) <= 0.03


def test_a_switch_itself_moves_the_velocity_less_than_a_prototype(reference: Run) -> None:
    """The motion that was going on anyway set apart: the second difference of the velocity.

    Going on, a velocity changes by much the same in each tick; what a switch adds shows in the
    change of the change.
    """
    v = np.vstack([reference.velocity_before, reference.v])
    bends = np.abs(np.diff(v, n=2, axis=0)).max(axis=1)  # bends[k]: into tick k + 1
    at_events = [float(bends[k - 1 : k - 1 + AFTER].max()) for k, _, _ in reference.events]
    assert max(at_events) < 0.5 * PROTOTYPE_STEP
    print(f"change of the velocity step at a switch {np.round(at_events, 5)} rad/s")


def test_the_unsmoothed_run_still_exchanges_the_object(unsmoothed: Run) -> None:
    check_laws(unsmoothed)
    assert unsmoothed.state.phase.done
    assert unsmoothed.object_error[unsmoothed.t > 0.3].max() < 1e-6


@pytest.mark.parametrize("fingers", [("f1", "f2"), ("f3", "f4")])
def test_double_normals(reference: Run, fingers: tuple[str, str]) -> None:
    """Each pair's normals end on one line: the chapter's condition in words."""
    names = reference.assembly.controller.law.kin.grasp.fingers
    a, b = (names.index(finger) for finger in fingers)
    last = reference.records[-1]
    across = last.contact_points[b] - last.contact_points[a]
    across /= np.linalg.norm(across)
    for finger, sign in ((a, -1.0), (b, 1.0)):
        np.testing.assert_allclose(last.contact_normals[finger], sign * across, atol=1e-5)

"""Pouring (section 1.5): two hands turn a bottle by 135° about its middle and back."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.control.state import Status

from .runs import Run, check_laws

FINGERS = ("thumb", "index", "middle", "ring", "little")


def angle(run: Run) -> np.ndarray:
    """(T,) how far the bottle has turned, [deg]."""
    turned = run.series("object_rotation") @ run.records[0].object_rotation.T
    return np.degrees(np.arccos(np.clip(0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0), -1, 1)))


def test_it_keeps_the_laws_of_every_run(pouring: Run) -> None:
    check_laws(pouring)


def test_it_turns_by_135_degrees_about_its_middle_rests_and_turns_back(pouring: Run) -> None:
    phase = pouring.state.phase
    assert phase.done and phase.timeouts == () and not pouring.events
    assert not pouring.status & ~Status.DONE
    assert pouring.series("mode").all(), "all ten hold, all the time"
    turned, empty = angle(pouring), pouring.series("phase") == 2
    np.testing.assert_allclose(turned[empty], 135.0, atol=1e-6)
    assert turned.max() < 135.0 + 1e-6
    assert np.ptp(pouring.t[empty]) == pytest.approx(0.4, abs=0.01)
    assert turned[-1] == pytest.approx(0.0, abs=1e-3)
    axes = pouring.series("object_rotation")[:, :, 2]
    np.testing.assert_allclose(axes[0], [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(axes[:, 1], 0.0, atol=1e-8)  # about y
    assert np.ptp(pouring.series("object_position"), axis=0).max() < 1e-9


def test_the_bottle_is_held_to_rounding_by_hands_that_keep_still(pouring: Run) -> None:
    position, turn = np.nanmax(pouring.series("object_error"), axis=(0, 1))
    assert position < 1e-9 and turn < 1e-8, (position, turn)
    names = pouring.assembly.model.joint_names
    fingers = [k for k, name in enumerate(names) if name.split("_")[1] in FINGERS]
    assert len(fingers) == 30
    assert np.degrees(np.ptp(pouring.q[:, fingers], axis=0).max()) < 0.1


def test_bodies_joints_and_velocities_keep_their_room(pouring: Run) -> None:
    model = pouring.assembly.model
    room = np.degrees(np.minimum(pouring.q - model.lower, model.upper - pouring.q).min(axis=0))
    arms = [k for k, name in enumerate(model.joint_names) if "_arm_" in name]
    distance, step = pouring.series("min_distance").min(), pouring.velocity_steps.max()
    print(
        f"distance {1e3 * distance:.2f} mm, joints {room.min():.2f} deg, arms "
        f"{room[arms].min():.2f} deg, velocity step {step:.4f} rad/s"
    )
    assert distance > 8e-3
    assert room.min() > 1.5 and room[arms].min() > 6.0
    assert step < 0.03

"""The reach to grasp: corners, laws, and exactly where it leaves the ranges."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.synergies import Reach, Synergies, tables, weights_of

HAND = Synergies.from_table()
LAWS: tuple[Literal["linear", "smooth"], ...] = ("linear", "smooth")
NAMES = (*tables().names, *tables().new_names)


@pytest.mark.parametrize("law", LAWS)
def test_zero_offset_open_hand_grasp(law: Literal["linear", "smooth"]) -> None:
    grasp = weights_of("C27")
    reach = Reach.to(HAND, grasp, law=law)
    hand_open = np.linalg.pinv(HAND.basis) @ (0.0 - HAND.mean)
    assert reach.duration == 6.0
    for time, weights in ((-1.0, np.zeros(3)), (0.0, np.zeros(3)), (3.0, hand_open),
                          (6.0, grasp), (9.0, grasp)):  # fmt: skip
        np.testing.assert_allclose(reach.weights(time), weights, atol=1e-15)
    np.testing.assert_array_equal(reach.weights(6.0), grasp)
    np.testing.assert_array_equal(reach.posture(0.0), HAND.mean)
    np.testing.assert_allclose(reach.weights(1.5), hand_open / 2, atol=1e-15)
    np.testing.assert_allclose(reach.weights(4.5), (hand_open + grasp) / 2, atol=1e-15)


def test_linear_is_linear() -> None:
    reach = Reach.to(HAND, weights_of("G3"))
    _, hand_open, grasp = reach.corners
    for time in (0.3, 1.0, 2.9):
        np.testing.assert_allclose(reach.weights(time), time / 3 * hand_open, atol=1e-15)
    for time in (3.1, 5.0):
        expected = hand_open + (time - 3) / 3 * (grasp - hand_open)
        np.testing.assert_allclose(reach.weights(time), expected, atol=1e-15)


@pytest.mark.parametrize("law", LAWS)
def test_rates_are_the_derivative(law: Literal["linear", "smooth"]) -> None:
    reach = Reach.to(HAND, weights_of("C5"), law=law, part=2.0)
    times = np.array([-0.5, 0.1, 0.7, 1.9, 2.1, 3.3, 3.9, 4.5])
    h = 1e-6
    slope = (reach.weights(times + h) - reach.weights(times - h)) / (2 * h)
    np.testing.assert_allclose(reach.rates(times), slope, atol=1e-8)


def test_smooth_is_at_rest_at_the_corners() -> None:
    """And of least jerk: a polynomial of degree five with position, speed, acceleration given."""
    reach = Reach.to(HAND, weights_of("C5"), law="smooth")
    corners = np.array([0.0, 3.0, 6.0])
    np.testing.assert_array_equal(reach.rates(corners), np.zeros((3, 3)))
    for corner in corners:
        for side in (-1e-4, 1e-4):
            assert np.abs(reach.rates(corner + side)).max() < 1e-7
    quintic = np.polyfit(np.linspace(0, 1, 30), reach.weights(np.linspace(0, 3, 30))[:, 0], 5)
    scaled = quintic / reach.corners[1, 0]
    np.testing.assert_allclose(scaled, [6, -15, 10, 0, 0, 0], atol=1e-8)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", NAMES)
def test_beyond_is_where_a_fine_sampling_is(name: str, law: Literal["linear", "smooth"]) -> None:
    reach = Reach.to(HAND, weights_of(name), law=law)
    found = reach.beyond()
    times = np.linspace(0.0, reach.duration, 2401)
    excess = HAND.excess(reach.posture(times))
    expected = np.zeros_like(excess)
    for joint, start, end, most in found:
        j = HAND.joints.index(joint)
        assert 0.0 <= start < end <= reach.duration
        inside = (times >= start) & (times <= end)
        expected[inside, j] = np.sign(most)
        assert np.abs(excess[inside, j]).max(initial=0.0) <= abs(most) + 1e-12
        corner = HAND.excess(HAND.posture(reach.corners))[:, j]
        assert np.abs(corner - most).min() < 1e-12
        for time in (start, end):  # at its limit there, unless the path begins or ends
            if 0.0 < time < reach.duration:
                value = reach.posture(time)[j]
                gap = min(abs(value - HAND.lower[j]), abs(value - HAND.upper[j]))
                assert gap < 1e-12
    clear = np.abs(excess) > 1e-9
    np.testing.assert_array_equal(np.sign(excess[clear]), expected[clear])
    assert (excess * expected > -1e-12).all()


def test_beyond_of_one_joint_by_hand() -> None:
    """One joint, −1 to 1 wide; zero offset 0.5, the open hand at 0, the grasp at 3."""
    one = Synergies(
        ("a",), np.array([0.5]), np.array([[1.0]]), np.ones(1), 1.0, -np.ones(1), np.ones(1)
    )
    (beyond,) = Reach.to(one, np.array([2.5])).beyond()
    assert beyond == ("a", pytest.approx(4.0), 6.0, pytest.approx(2.0))
    smooth = Reach.to(one, np.array([2.5]), law="smooth").beyond()[0]
    u = (smooth.start - 3.0) / 3.0
    assert 10 * u**3 - 15 * u**4 + 6 * u**5 == pytest.approx(1 / 3, abs=1e-14)
    stay = Reach(one, np.array([[0.0], [1.5], [0.7]]))  # out over the corner: one stay
    assert stay.beyond() == (("a", pytest.approx(1.0), 6.0, pytest.approx(1.0)),)
    unlimited = Synergies.fit(np.array([[0.0], [1.0]]), count=1)
    assert Reach.to(unlimited, np.array([9.0])).beyond() == ()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"grasp": np.zeros(2)}, "a grasp has 3 weights"),
        ({"grasp": np.array([0.0, np.nan, 0.0])}, "finite weights"),
        ({"law": "quadratic"}, "'linear' or 'smooth', not 'quadratic'"),
        ({"part": 0.0}, "a positive time, not 0.0 s"),
        ({"part": np.nan}, "a positive time"),
    ],
)
def test_faults(options: dict, says: str) -> None:  # type: ignore[type-arg]
    grasp = options.pop("grasp", np.zeros(3))
    with pytest.raises(WbcError, match=says):
        Reach.to(HAND, grasp, **options)
    with pytest.raises(WbcError, match="a time is needed"):
        Reach.to(HAND, np.zeros(3)).weights(np.nan)

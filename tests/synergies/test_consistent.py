"""Full postures that the tables could have been computed from: they give the tables back."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from sklearn.decomposition import PCA

from wbc.synergies import Synergies, consistent_postures, tables
from wbc.synergies.consistent import repaired_basis
from wbc.synergies.derived import measured_thumb
from wbc.synergies.tables import half_units

T = tables()
POSTURES = consistent_postures()
HAND = Synergies.fit(POSTURES, T.joints)
BOTH = ("two_synergies", "three_synergies")


def offsets(count: int) -> np.ndarray:
    """c − ĉ of all postures with some synergies, [deg]."""
    hand = Synergies.fit(POSTURES, T.joints, count=count)
    left: np.ndarray = np.rad2deg(POSTURES - hand.posture(hand.project(POSTURES)))
    return left


def test_one_entry_of_table_1_has_two_digits_exchanged() -> None:
    """And not the columns' length is to be doubted: it mends the products with e₁ and e₂ too."""
    repaired = repaired_basis()
    different = np.argwhere(np.abs(repaired - T.basis) > 5e-5)
    assert [(T.joints[j], k) for j, k in different] == [("thumb_prox", 2)]
    assert round(repaired[1, 2], 4) == -0.3693 and T.basis[1, 2] == -0.3639
    for basis, low, high in ((T.basis, 3.9e-3, 4e-3), (repaired, 0.0, 1e-4)):
        assert low < np.abs(basis.T @ basis - np.eye(3)).max() < high


def test_table_1_and_the_signs() -> None:
    """To its digits, but for the entry with the digits exchanged."""
    np.testing.assert_allclose(HAND.basis, repaired_basis(), atol=5.01e-5)
    cosines = (HAND.basis * repaired_basis()).sum(axis=0)
    assert np.rad2deg(np.arccos(np.minimum(cosines, 1.0))).max() < 0.006
    printed = (HAND.basis * T.basis).sum(axis=0) / np.linalg.norm(T.basis, axis=0)
    assert np.rad2deg(np.arccos(printed)).max() < 0.29
    unit = half_units("table1", ("mean",))[:, 0]
    assert (np.abs(np.rad2deg(HAND.mean) - T.mean) < unit).all()


def test_shares_of_the_variance() -> None:
    assert np.round(HAND.explained, 3).tolist() == [0.599, 0.772, 0.850]
    assert round(HAND.explained[2], 4) == 0.8503
    printed = Synergies.from_table()
    np.testing.assert_allclose(HAND.variances, printed.variances, rtol=5e-3)


def test_table_2() -> None:
    unit = half_units("table2", ("alpha1", "alpha2", "alpha3"))
    assert (np.abs(np.rad2deg(HAND.project(POSTURES)) - T.weights) < unit).all()


def test_table_3() -> None:
    unit = half_units("table3", BOTH)
    gap = np.stack([np.abs(offsets(k)[:, 0]) for k in (2, 3)], axis=1) - T.thumb_errors
    off = np.abs(gap) / unit
    assert (off[:, 1] < 1.0).all()
    others = [name for name, value in zip(T.names, off[:, 0], strict=True) if value > 1.0]
    assert others == ["C4", "C15", "C16"] and off.max() < 2.0  # one unit of the last digit
    assert np.abs(gap).max() < 0.052


def test_table_4() -> None:
    unit = half_units("table4", BOTH)
    errors = np.stack([np.linalg.norm(offsets(k), axis=1) / 15 for k in (2, 3)], axis=1)
    assert (np.abs(errors - T.errors) < unit).all()


def test_thumb_is_what_was_measured() -> None:
    np.testing.assert_allclose(np.rad2deg(POSTURES[:, 0]), measured_thumb(), atol=1e-9)


def test_what_is_left_is_outside_the_synergies() -> None:
    weights, left = HAND.project(POSTURES), np.deg2rad(offsets(3))
    assert np.abs(left @ HAND.basis).max() < 1e-12
    assert np.abs(left.sum(axis=0)).max() < 1e-12
    assert np.abs(weights.T @ left).max() < 1e-11
    fourth = np.rad2deg(np.rad2deg(Synergies.fit(POSTURES, count=4).variances[3]))
    assert 300 < fourth < 400  # the third synergy's is 642


def test_a_hand_can_take_them() -> None:
    assert (Synergies.from_table().excess(POSTURES) == 0.0).all()
    assert POSTURES.shape == (36, 15) and not POSTURES.flags.writeable


def test_scikit_learn_finds_the_same() -> None:
    theirs = PCA(3).fit(POSTURES)
    cosines = (theirs.components_ * HAND.basis.T).sum(axis=1)
    np.testing.assert_allclose(np.abs(cosines), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.cumsum(theirs.explained_variance_ratio_), HAND.explained)


def test_the_same_bits_in_another_process() -> None:
    code = (
        "import hashlib; from wbc.synergies import consistent_postures as c;"
        "print(hashlib.sha256(c().tobytes()).hexdigest())"
    )
    first, second = (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert first.stdout == second.stdout

"""What is drawn for a trial: how it is spread, and that each quantity is drawn for itself."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.stats import kstest

from wbc.sim.disturbances import Disturbance, Lost, Push, Ranges, draw

MANY = 2000
ALL = Ranges(
    mass=0.3, friction=0.3, size=0.1, position=0.005, rotation=0.035, gravity=0.05,
    force_noise=0.05, force_floor=0.1, joint_noise=2e-4, velocity_noise=1e-3, delay=0.003,
    dropout=0.01, pushes=(Push(3.0, (1.0, 0.0, 0.0), 0.05),), lost=(Lost("f1", 4.0, 0.1),),
)  # fmt: skip


def drawn(name: str, *, planar: bool = False) -> np.ndarray:
    return np.array([getattr(draw(ALL, seed, planar=planar), name) for seed in range(MANY)])


@pytest.mark.parametrize("name", ["mass", "friction", "size", "gravity"])
def test_factors_are_uniform_about_one(name: str) -> None:
    most = getattr(ALL, name)
    assert kstest((drawn(name) - 1.0) / most, "uniform", (-1.0, 2.0)).pvalue > 1e-3


@pytest.mark.parametrize("name", ["position", "rotation"])
def test_offsets_point_anywhere_and_go_up_to_their_range(name: str) -> None:
    values = drawn(name)
    lengths = np.linalg.norm(values, axis=1)
    assert kstest(lengths / getattr(ALL, name), "uniform").pvalue > 1e-3
    for axis in (values / lengths[:, None]).T:  # on a sphere each coordinate is uniform
        assert kstest(axis, "uniform", (-1.0, 2.0)).pvalue > 1e-3


def test_in_the_plane_nothing_leaves_it() -> None:
    position, rotation = drawn("position", planar=True), drawn("rotation", planar=True)
    assert not position[:, 2].any() and not rotation[:, :2].any()
    angle = np.arctan2(position[:, 1], position[:, 0])
    assert kstest(angle, "uniform", (-np.pi, 2.0 * np.pi)).pvalue > 1e-3
    assert kstest(rotation[:, 2] / ALL.rotation, "uniform", (-1.0, 2.0)).pvalue > 1e-3


def test_quantities_do_not_go_together() -> None:
    rows = [drawn(name) for name in ("mass", "friction", "size", "gravity", "seed")]
    rows += [*drawn("position").T, *drawn("rotation").T]
    between = np.corrcoef(rows) - np.eye(len(rows))
    assert np.abs(between).max() < 0.1


@pytest.mark.parametrize("name", ["mass", "friction", "size", "position", "rotation", "gravity"])
def test_asking_for_one_more_changes_none_of_the_others(name: str) -> None:
    most = draw(dataclasses.replace(ALL, **{name: 0.0}), 7)
    exact = getattr(Disturbance(), name)
    assert most == dataclasses.replace(draw(ALL, 7), **{name: exact})


def test_the_same_seed_draws_the_same_and_another_does_not() -> None:
    assert draw(ALL, 5) == draw(ALL, 5)
    assert draw(ALL, 5).mass != draw(ALL, 6).mass
    assert draw(ALL, 2**62).seed != draw(ALL, 2**62 + 1).seed


def test_without_ranges_nothing_is_wrong() -> None:
    assert dataclasses.replace(draw(Ranges(), 3), seed=0) == Disturbance()


def test_what_is_not_drawn_is_as_given() -> None:
    found = draw(ALL, 1)
    for name in ("force_noise", "force_floor", "joint_noise", "velocity_noise", "delay", "dropout"):
        assert getattr(found, name) == getattr(ALL, name)
    assert found.pushes == ALL.pushes and found.lost == ALL.lost


def test_the_record_is_plain() -> None:
    found = draw(ALL, 1)
    record = json.loads(json.dumps(found.as_record(), allow_nan=False))
    assert record["mass"] == found.mass and record["position"] == list(found.position)
    assert record["pushes"] == [{"at": 3.0, "force": [1.0, 0.0, 0.0], "over": 0.05}]
    assert record["lost"] == [{"finger": "f1", "at": 4.0, "over": 0.1}]
    assert set(record) == {field.name for field in dataclasses.fields(Disturbance)}

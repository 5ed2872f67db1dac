"""The laws of every cost, over the table of all of them."""

from __future__ import annotations

from dataclasses import is_dataclass

import numpy as np
import pytest

import wbc.costs
from conformance.cost_table import COSTS, CostExample
from conformance.discovery import concrete, snapshot
from conformance.worlds import central_difference, make_world, seeded
from wbc.costs import Collision, Cost

SEEDS = range(4)


def rows_of_table(spots: str = "spots"):  # type: ignore[no-untyped-def]
    """pytest parameters: case, robot, place, spot; with readable ids."""
    out = [
        pytest.param(
            case,
            robot,
            place,
            spot,
            id="-".join([kind.__name__ + str(n), robot, place, spot]),
        )
        for kind, cases in COSTS.items()
        for n, case in enumerate(cases)
        for robot in case.robots
        for place in case.places
        for spot in getattr(case, spots)
    ]
    return pytest.mark.parametrize(("case", "robot", "place", "spot"), out)


def example_of(case, robot, place, spot, seed) -> CostExample:  # type: ignore[no-untyped-def]
    world = make_world(robot, place=place, seed=(seed, spot))
    return case.make(world, seeded(robot, place, spot, seed), spot)


def test_every_cost_class_is_in_the_table() -> None:
    assert concrete(Cost, wbc.costs) == set(COSTS)


@pytest.mark.parametrize("kind", COSTS, ids=lambda kind: kind.__name__)
def test_cost_classes_are_final_frozen_and_exported(kind: type[Cost]) -> None:
    assert getattr(kind, "__final__", True) is True and not kind.__subclasses__()
    assert is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    assert kind.__name__ in wbc.costs.__all__


@rows_of_table()
def test_gradient_is_the_derivative_of_the_value(case, robot, place, spot) -> None:  # type: ignore[no-untyped-def]
    """γ ∂C/∂q, the object at rest."""
    for seed in SEEDS:
        example = example_of(case, robot, place, spot, seed)
        _, got = example.gradient()
        q = example.world.q
        want = np.array(
            [
                central_difference(lambda t, x=example, e=e, q=q: x.at(q + t * e), 1e-5)
                for e in np.eye(len(q))
            ]
        )
        assert np.all(np.isfinite(got))
        want *= example.cost.weight
        assert np.abs(got - want).max() < 1e-6 * max(1.0, np.abs(want).max())


@pytest.mark.parametrize("case", COSTS[Collision], ids=["settled", "printed"])
@pytest.mark.parametrize("seed", range(8))
def test_collision_gradient_of_parallel_links_is_between_its_two_sides(case, seed) -> None:  # type: ignore[no-untyped-def]
    """Where the distance has a kink the gradient is one that holds on one side, or in between."""
    example = example_of(case, "planar", "limits", "parallel", seed)
    value, got = example.gradient()
    q, step = example.world.q, 1e-7
    sides = np.array(
        [[(example.at(q + s * e) - value) / s for s in (-step, step)] for e in np.eye(len(q))]
    )
    sides *= example.cost.weight
    slack = 1e-4 * max(1.0, np.abs(sides).max())
    assert np.all(got > sides.min(axis=1) - slack) and np.all(got < sides.max(axis=1) + slack)


@rows_of_table("silent")
def test_costs_are_zero_away_from_their_constraints(case, robot, place, spot) -> None:  # type: ignore[no-untyped-def]
    for seed in SEEDS:
        value, gradient = example_of(case, robot, place, spot, seed).gradient()
        assert value == 0.0 and not gradient.any()


@rows_of_table()
def test_costs_are_pure_positive_and_add_to_the_gradient(case, robot, place, spot) -> None:  # type: ignore[no-untyped-def]
    example = example_of(case, robot, place, spot, 0)
    value, gradient = example.gradient()
    kin = example.world.kin.robot
    before = snapshot(kin, example.cost, *([example.distances.value] if example.distances else []))
    assert value == example.cost.value(kin, example.distances) and value >= 0.0
    sum_ = np.full(len(gradient), 7.0)
    assert example.cost.add_gradient(kin, example.distances, sum_) == value
    assert np.allclose(sum_ - 7.0, gradient, rtol=1e-12, atol=1e-12)
    after = snapshot(kin, example.cost, *([example.distances.value] if example.distances else []))
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))

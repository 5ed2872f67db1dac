"""The tables hang together: what follows from some of their numbers are others of them."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from wbc.synergies import Synergies, derived, tables
from wbc.synergies.derived import measured_thumb

URDF = Path(__file__).parents[2] / "urdf" / "dexmart_hand_right.urdf"


def test_shares_of_the_variance() -> None:
    sigma = derived()["sigma"]
    assert [round(s, 3) for s in sigma] == [0.599, 0.772, 0.850]
    assert sigma[1] > 0.77 and abs(sigma[2] - 0.8503) < 5e-5


def test_variances_in_degrees() -> None:
    variances = np.rad2deg(np.rad2deg(Synergies.from_table().variances))
    assert variances.round().tolist() == [4934, 1432, 642]


def test_two_synergy_columns_follow_from_the_three_synergy_columns() -> None:
    t, d = tables(), derived()
    assert np.abs(np.array(d["table4_two_syn"]) - t.errors[:, 0]).max() < 0.01
    assert np.abs(np.array(d["table3_two_syn"]) - t.thumb_errors[:, 0]).max() < 0.05


def test_the_short_third_column_would_fit_worse() -> None:
    t = tables()
    printed = np.linalg.norm(t.basis[:, 2])
    short = np.hypot(15 * t.errors[:, 1], t.weights[:, 2] * printed) / 15
    assert printed < 0.9981 and np.abs(short - t.errors[:, 0]).max() > 0.01


def test_measured_thumb() -> None:
    t, measured = tables(), measured_thumb()
    assert Counter(measured) == {-10.0: 19, 10.0: 16, 0.0: 1}
    assert measured.mean() == pytest.approx(-30 / 36) and abs(measured.mean() - t.mean[0]) < 5e-4
    # the other column of Table 3, which measured_thumb does not look at
    two = t.mean[0] + t.weights[:, :2] @ t.basis[0, :2]
    assert (
        np.abs(np.abs(measured - two) - t.thumb_errors[:, 0]).max() < 0.06
    )  # 0.0512 in C15, printed 10.5


def test_postures_by_sums_written_out() -> None:
    t, d = tables(), derived()
    for name, weights, posture in zip(d["names"], d["alpha"], d["postures_deg"], strict=True):
        rows = t.names.index(name) if name in t.names else t.new_names.index(name)
        source = t.weights if name in t.names else t.new_weights
        assert weights == list(source[rows])
        for j in range(15):
            by_hand = t.mean[j] + sum(t.basis[j, k] * weights[k] for k in range(3))
            assert posture[j] == pytest.approx(by_hand, abs=1e-12)
    assert d["names"] == [f"C{i}" for i in range(1, 37)] + [f"G{i}" for i in range(1, 6)]


def test_all_postures_are_within_the_robot_description() -> None:
    d = derived()
    limits = {
        joint.get("name"): [float(joint.find("limit").get(end)) for end in ("lower", "upper")]
        for joint in etree.parse(URDF).findall("joint")
        if joint.find("limit") is not None
    }
    low, high = np.rad2deg([limits[name] for name in d["joints"]]).T
    postures = np.array(d["postures_deg"])
    margin = np.minimum(postures - low, high - postures).min()
    assert postures.shape == (41, 15) and margin > 4.3


def test_seventeen_postures_leave_the_ranges_of_the_hand() -> None:
    d = derived()
    beyond = d["beyond_limits"]
    assert len(beyond) == 17
    largest = max((abs(v), name, joint) for name, row in beyond.items() for joint, v in row.items())
    assert largest[1:] == ("C34", "thumb_med") and round(largest[0], 1) == 23.3
    assert beyond["C34"]["thumb_med"] < 0.0 < beyond["C10"]["index_med"]
    # 34 values; one of them, C16's ring finger, by less than the printed digits can tell
    values = [abs(v) for row in beyond.values() for v in row.values()]
    assert len(values) == 34 and sum(v > 0.01 for v in values) == 33
    assert beyond["C16"]["ring_prox"] < 0.01


def test_a_command_is_the_clipped_posture() -> None:
    t, d = tables(), derived()
    commanded, postures = np.array(d["commanded_deg"]), np.array(d["postures_deg"])
    assert ((t.lower <= commanded) & (commanded <= t.upper)).all()
    for name, row, there in zip(d["names"], postures, commanded, strict=True):
        excess = d["beyond_limits"].get(name, {})
        back = np.array([excess.get(joint, 0.0) for joint in d["joints"]])
        np.testing.assert_allclose(there + back, row, atol=1e-6)


def test_ready_for_json_and_the_same_every_time() -> None:
    first = json.dumps(derived(), allow_nan=False)
    assert first == json.dumps(derived(), allow_nan=False)


def test_rows_of_all_tables_have_the_same_order() -> None:
    data = Path(__file__).parents[2] / "wbc" / "synergies" / "data"
    first = {
        name: [
            line.split(",")[0]
            for line in (data / f"{name}.csv").read_text(encoding="utf-8").splitlines()
            if line and not line.startswith("#")
        ][1:]
        for name in ("table1", "table2", "table3", "table4", "ranges")
    }
    assert first["table2"] == first["table3"] == first["table4"]
    assert first["table1"] == first["ranges"]

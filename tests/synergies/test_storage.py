"""Synergies in a file: every bit comes back, and a fault is one line."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wbc.errors import WbcError
from wbc.synergies import Synergies
from wbc.synergies.reading import MAX_BYTES

ARRAYS = ("mean", "basis", "variances", "lower", "upper")


def written(tmp_path: Path, **changes: Any) -> Path:
    """A file of the published synergies with some keys changed; ``...`` leaves a key out."""
    path = Synergies.from_table().save(tmp_path / "hand.json")
    content = json.loads(path.read_text()) | changes
    kept = {key: value for key, value in content.items() if value is not ...}
    path.write_text(json.dumps(kept))
    return path


def test_every_bit_comes_back(tmp_path: Path) -> None:
    one_sided = Synergies(
        ("a", "b"), np.array([1 / 3, -0.0]), np.array([[0.1], [2e-300]]), np.array([0.3]), 0.7,
        np.array([-np.inf, -1.1]), np.array([1.2, np.inf]),
    )  # fmt: skip
    for synergies in (Synergies.from_table(), one_sided):
        path = synergies.save(tmp_path / "new" / "hand.json")
        again = Synergies.load(path)
        assert again.joints == synergies.joints
        assert again.total_variance == synergies.total_variance
        for name in ARRAYS:
            assert getattr(again, name).tobytes() == getattr(synergies, name).tobytes()
        assert again.save(tmp_path / "second.json").read_bytes() == path.read_bytes()


def test_degrees(tmp_path: Path) -> None:
    there = Synergies.from_table()
    path = written(
        tmp_path,
        unit="deg",
        mean=np.rad2deg(there.mean).tolist(),
        variances=np.rad2deg(np.rad2deg(there.variances)).tolist(),
        total_variance=float(np.rad2deg(np.rad2deg(there.total_variance))),
        lower=np.rad2deg(there.lower).tolist(),
        upper=np.rad2deg(there.upper).tolist(),
    )
    again = Synergies.load(path)
    for name in ARRAYS:
        np.testing.assert_allclose(getattr(again, name), getattr(there, name), rtol=1e-15)
    assert again.total_variance == pytest.approx(there.total_variance, rel=1e-15)


ROW = [0.5] * 15


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "wbc synergies 2"}, "key 'format' must be \"wbc synergies 1\""),
        ({"format": ...}, "key 'format' must be"),
        ({"unit": "grad"}, "key 'unit': unit 'grad' is not known; write 'rad' or 'deg'"),
        ({"unit": ["deg"]}, "key 'unit': unit '['deg']' is not known"),
        ({"mean": ...}, "key 'mean' is missing; add it"),
        ({"means": ROW}, "key 'means' is not known (did you mean 'mean'?)"),
        ({"mean": ROW[1:]}, "key 'mean' must be a list of 15 numbers, got 14 entries"),
        ({"mean": "zero"}, "key 'mean' must be a list of 15 numbers, got 'zero'"),
        ({"mean": [True, *ROW[1:]]}, "key 'mean', entry 1: 'True' is no number"),
        ({"mean": [None, *ROW[1:]]}, "key 'mean', entry 1: 'None' is no number"),
        ({"mean": [34.7, *ROW[1:]]}, "34.7 rad of joint 'thumb_abd' is more than a full turn; "
                                     'write "unit": "deg"'),
        ({"upper": [85.0] * 15}, "key 'upper': 85 rad"),
        ({"mean": [1000.0, *ROW[1:]], "unit": "deg"}, "1000 deg of joint 'thumb_abd'"),
        ({"joints": ["a"] * 15}, "key 'joints': 'a' is named twice"),
        ({"joints": ["a\n"] * 15}, "key 'joints': 'a?' is no name of a joint"),
        ({"joints": [1.0]}, "key 'joints': '1.0' is no name of a joint"),
        ({"joints": []}, "key 'joints': 0 joints; between 1 and 1000"),
        ({"joints": {}}, "key 'joints' must be a list"),
        ({"synergies": [ROW, ROW[1:], ROW]}, "key 'synergies, number 2' must be a list of 15"),
        ({"synergies": []}, "key 'synergies' must be a list of 1 to 15 lists"),
        ({"synergies": [ROW] * 3}, "3 directions of 15 joints are not independent"),
        ({"synergies": [[0.0] * 15] * 3}, "3 directions of 15 joints are not independent"),
        ({"variances": [1.0, -1.0, 0.0]}, "a variance is negative"),
        ({"total_variance": 0.1}, "the total variance is below"),
        ({"total_variance": 1e400}, "Infinity is no number of JSON"),
        ({"lower": [1.0] * 15, "upper": [0.5] * 15}, "lower limit is above its upper one"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    path = written(tmp_path, **changes)
    with pytest.raises(WbcError) as caught:
        Synergies.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", ":1: the file is empty"),
        (b"{", ":1: not JSON"),
        (b'{"mean": [1,\n 2,]}', ":2: not JSON"),
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a":' * 100_000, "nested too deeply"),
        (b"[1, 2]", "not an object"),
        (b'{"mean": 1, "mean": 2}', "key 'mean' is there twice"),
        (b'{"mean": NaN}', "NaN is no number of JSON"),
        (b'{"mean": ' + b"9" * 100_000 + b"}", "key 'format'"),
        (b"\n{\xff", ":2: not UTF-8 text"),
        (b"{}\n\0", ":2: a NUL byte"),
        (b" " * (MAX_BYTES + 1), "larger than 16 MB"),
    ],
)
def test_a_foreign_file_is_one_line(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "hand.json"
    path.write_bytes(data)
    with pytest.raises(WbcError) as caught:
        Synergies.load(path)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_file_is_one_line(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, says in (("pipe", "not a regular file"), (".", "not a regular file"),
                       ("none", "No such file"), ("a\0b", "cannot be read")):  # fmt: skip
        with pytest.raises(WbcError, match=says) as caught:
            Synergies.load(tmp_path / path)
        assert "\n" not in str(caught.value)
    with pytest.raises(WbcError, match="cannot write"):
        Synergies.from_table().save(tmp_path)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_any_file_is_read_or_refused(data: st.DataObject, tmp_path_factory: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "any.json"
    entry = st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers()
    value = st.recursive(entry, lambda inner: st.lists(inner, max_size=4), max_leaves=8)
    keys = ("joints", "mean", "synergies", "variances", "total_variance", "lower", "upper", "unit")
    if data.draw(st.booleans()):
        path.write_bytes(data.draw(st.binary(max_size=200)))
    else:
        good = {"format": "wbc synergies 1", "unit": "rad", "joints": ["a", "b"], "mean": [0, 0],
                "synergies": [[1, 0]], "variances": [1], "total_variance": 2,
                "lower": [-1, None], "upper": [1, None]}  # fmt: skip
        changed = data.draw(st.dictionaries(st.sampled_from(keys) | st.text(), value, max_size=2))
        path.write_text(json.dumps(good | changed))
    try:
        Synergies.load(path)
    except WbcError as error:
        assert len(str(error).splitlines()) == 1

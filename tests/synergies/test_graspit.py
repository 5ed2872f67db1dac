"""Eigengrasp files of GraspIt!: the map from weights to joints, and one line for each fault."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.errors import WbcError
from wbc.synergies import Synergies, read_eigengrasps

JOINTS = ("a", "b", "c")
FILE = """<?xml version="1.0" ?>
<EigenGrasps dimensions="3">
  <EG>
    <EigenValue value="0.5"/>
    <Limits min="-1" max="2.5"/>
    <DimVals d0="3" d2="4"/>
  </EG>
  <EG>
    <!-- not of length one, not orthogonal -->
    <EigenValue value="0.25"/>
    <DimVals d0="1.0" d1="-1e0" d2=".0"/>
  </EG>
  <ORIGIN>
    <EigenValue value="0.0"/>
    <DimVals d0="0.1" d1="0.2" d2="-0.3"/>
  </ORIGIN>
  <NORM>
    <DimVals d0="2" d1="0.5" d2="1"/>
  </NORM>
</EigenGrasps>
"""
WITHOUT_NORM = FILE[: FILE.index("  <NORM>")] + "</EigenGrasps>\n"
WITHOUT_ORIGIN = FILE[: FILE.index("  <ORIGIN>")] + "</EigenGrasps>\n"


def read(tmp_path: Path, text: str, joints: Any = JOINTS, **limits: Any) -> Synergies:
    path = tmp_path / "eigen.xml"
    path.write_text(text, encoding="utf-8")
    return read_eigengrasps(path, joints, **limits)


def test_joint_values_written_out(tmp_path: Path) -> None:
    """q_d = Σ_e a_e d_e,d / |d_e| · NORM_d + ORIGIN_d"""
    a1, a2 = 0.7, -0.4
    hand = read(tmp_path, FILE)
    first = [
        (a1 * 3 / 5 + a2 / math.sqrt(2)) * 2 + 0.1,
        (-a2 / math.sqrt(2)) * 0.5 + 0.2,
        a1 * 4 / 5 - 0.3,
    ]
    np.testing.assert_allclose(hand.posture(np.array([a1, a2])), first, atol=1e-15)
    np.testing.assert_allclose(hand.project(np.array(first)), [a1, a2], atol=1e-14)
    assert hand.joints == JOINTS and hand.variances.tolist() == [0.5, 0.25]
    assert hand.explained.tolist() == [0.5, 0.75]


def test_without_norm_the_projection_is_graspits_too(tmp_path: Path) -> None:
    """(E Eᵀ)⁻¹ E (q − o) for rows of E of length one, of any posture."""
    hand = read(tmp_path, WITHOUT_NORM)
    rows = np.array([[0.6, 0.0, 0.8], [math.sqrt(0.5), -math.sqrt(0.5), 0.0]])
    posture = np.array([0.5, -0.6, 0.9])
    weights = np.linalg.inv(rows @ rows.T) @ rows @ (posture - [0.1, 0.2, -0.3])
    np.testing.assert_allclose(hand.project(posture), weights, atol=1e-14)


def test_origin_within_the_ranges(tmp_path: Path) -> None:
    limits = {"lower": np.array([0.15, 0.0, -1.0]), "upper": np.array([1.0, 0.1, 1.0])}
    hand = read(tmp_path, FILE, **limits)
    np.testing.assert_array_equal(hand.mean, [0.15, 0.1, -0.3])
    np.testing.assert_array_equal(hand.lower, limits["lower"])
    hand = read(tmp_path, WITHOUT_ORIGIN, **limits)
    np.testing.assert_allclose(hand.mean, [0.575, 0.05, 0.0])
    with pytest.raises(WbcError, match=r"eigen.xml:2: no <ORIGIN>: it is the middle of the ranges"):
        read(tmp_path, WITHOUT_ORIGIN)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('dimensions="3"', 'dimensions="4"', ":2: a hand of 4 joints, but 3 are named"),
        ('dimensions="3"', 'dimensions="3.5"', ':2: dimensions="3.5" is no number'),
        ('dimensions="3"', "", ':2: dimensions="" is no number'),
        ("EigenGrasps", "Eigen", ":2: the root element is <Eigen>, not <EigenGrasps>"),
        ("ORIGIN", "ORIGN", ":13: <ORIGN> is not known here (did you mean 'ORIGIN'?)"),
        ("NORM", "ORIGIN", ":17: a second <ORIGIN>"),
        ("<Limits ", "<Limit ", ":5: <Limit> is not known here (did you mean 'Limits'?)"),
        ('<DimVals d0="3" d2="4"/>', "", ":3: <EG> has no <DimVals>"),
        ('d2="4"', 'd3="4"', ":6: 'd3' is no dimension (they are d0 to d2)"),
        ('d2="4"', 'd2="4,0"', ':6: d2="4,0" is not a number'),
        ('d2="4"', 'd2="nan"', ':6: d2="nan" is not finite'),
        ('d2="4"', 'd2="1e9"', ':6: d2="1e9" is beyond any hand'),
        ('d0="3" d2="4"', 'd0="0"', ":3: an eigengrasp of length zero"),
        ('d0="3" d2="4"', 'd0="-2" d1="2"', ":2: synergies: 2 directions of 3 joints are not ind"),
        ('d0="2" d1="0.5"', 'd0="2"', ":17: d1 of NORM is zero or absent"),
        ('value="0.5"', 'value="-1"', ":4: the eigenvalue -1 is negative"),
        ('value="0.5"', "", ":4: <EigenValue> has no value"),
        ('min="-1"', 'min="3"', ":5: min is above max"),
        ("</NORM>", "", ":20: not well-formed XML"),
        ("<EigenG", '<!DOCTYPE x [<!ENTITY a "b">]>\n<EigenG', ":2: <!DOCTYPE"),
        ('<DimVals d0="3" d2="4"/>', '<DimVals d0="3"/><DimVals d0="3"/>', ":6: a second <DimVals"),
    ],
)
def test_a_fault_is_one_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in FILE
    with pytest.raises(WbcError) as caught:
        read(tmp_path, FILE.replace(old, new))
    assert f"eigen.xml{says}" in str(caught.value) and "\n" not in str(caught.value)


def test_other_faults(tmp_path: Path) -> None:
    with pytest.raises(WbcError, match="'a' is named twice"):
        read(tmp_path, FILE, ("a", "a", "c"))
    with pytest.raises(WbcError, match="more than 10000 elements"):
        read(tmp_path, FILE.replace("<NORM>", "<NORM>" + "<x/>" * 30_000))
    with pytest.raises(WbcError, match="one limit for each of 3"):
        read(tmp_path, FILE, lower=np.zeros(2))


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_file_is_read_or_refused(data: st.DataObject, tmp_path_factory: Any) -> None:
    path = tmp_path_factory.getbasetemp() / "any.xml"
    if data.draw(st.booleans()):
        path.write_bytes(data.draw(st.binary(max_size=100)))
    else:
        start = data.draw(st.integers(0, len(FILE)))
        piece = data.draw(st.binary(max_size=6) | st.sampled_from([b"<EG>", b'd0="x"', b"9", b"/"]))
        cut = data.draw(st.integers(0, 12))
        path.write_bytes(FILE.encode()[:start] + piece + FILE.encode()[start + cut :])
    try:
        read_eigengrasps(path, JOINTS)
    except WbcError as error:
        assert len(str(error).splitlines()) == 1

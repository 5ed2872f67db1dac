"""Recorded postures: units, columns by name, and one line for each fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.errors import WbcError
from wbc.synergies import Synergies, read_postures

JOINTS = ("abd", "prox", "med")
RANGES: dict[str, Any] = {"lower": np.deg2rad([-15, -5, 0]), "upper": np.deg2rad([15, 85, 85])}


def file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "postures.csv"
    path.write_text(text, encoding="utf-8")
    return path


def fault(tmp_path: Path, text: str, joints: Any = JOINTS, **options: Any) -> str:
    """The message for a file, without the file's name."""
    path = file(tmp_path, text)
    with pytest.raises(WbcError) as caught:
        read_postures(path, joints, **options)
    lines = str(caught.value).split("\n")
    assert all(line.startswith(str(path)) for line in lines)
    return "\n".join(line.removeprefix(str(path)) for line in lines)


def test_columns_are_found_by_name(tmp_path: Path) -> None:
    path = file(tmp_path, "\ufeff# by hand\nposture, med,abd,prox\r\n\nopen,0.1,0.2,.3\nx,1,0,1e-1")
    read = read_postures(path, JOINTS, **RANGES)
    assert read.names == ("open", "x") and read.joints == JOINTS
    np.testing.assert_array_equal(read.values, [[0.2, 0.3, 0.1], [0.0, 0.1, 1.0]])
    assert not read.values.flags.writeable
    assert read_postures(path).joints == ("med", "abd", "prox")


def test_unit_of_the_file_or_the_caller(tmp_path: Path) -> None:
    rows = "abd,prox,med\n-10,20,34.7\n"
    expected = np.deg2rad([[-10.0, 20.0, 34.7]])
    for head, unit in (("# unit: deg\n", None), ("#UNITS = deg\n", None), ("", "deg"),
                       ("# unit: deg\n", "deg")):  # fmt: skip
        read = read_postures(file(tmp_path, head + rows), JOINTS, unit=unit, **RANGES)
        np.testing.assert_allclose(read.values, expected, rtol=1e-15)
        assert read.names == ("posture_1",)


def test_degrees_without_a_word_are_refused(tmp_path: Path) -> None:
    says = fault(tmp_path, "abd,prox,med\n0,20,34.7\n", **RANGES)
    assert says == (
        ":2: prox = 20 rad, med = 34.7 rad far beyond what the joint can do "
        "(looks like degrees, say '# unit: deg')"
    )
    assert "looks like degrees" in fault(tmp_path, "abd,prox,med\n0,20,34.7\n")
    says = fault(tmp_path, "# unit: rad\nabd,prox,med\n0,20,0\n", **RANGES)
    assert "(is the unit rad right?)" in says
    assert "500 deg" in fault(tmp_path, "abd,prox,med\n0,500,0\n", unit="deg", **RANGES)


def test_a_posture_somewhat_out_of_range_is_read(tmp_path: Path) -> None:
    path = file(tmp_path, "# unit: deg\nabd,prox,med\n18,-5,-23.3\n")
    assert read_postures(path, JOINTS, **RANGES).values[0, 2] == np.deg2rad(1.0) * -23.3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("abd,prox\n0,0\n", ":1: no column for med (add it)"),
        ("abd\n0\n", ":1: no column for prox, med (add it)"),
        ("abd,prox,med,mid\n0,0,0,0\n", ":1: no joint is called 'mid' (did you mean 'med'?)"),
        ("abd,prox,med,med\n0,0,0,0\n", ":1: 'med' is named twice (the header"),
        ("abd,prox,,med\n0,0,0,0\n", ":1: '' is no name of a joint"),
        ("abd;prox;med\n0,1;0;0\n", ":1: the columns are separated by ';' (separate them by comm"),
        ("abd\tprox\tmed\n0\t0\t0\n", ":1: the columns are separated by tabs"),
        ("0.1,0.2,0.3\n", ":1: the header row is missing"),
        ("posture\nC1\n", ":1: no joint is named"),
        ("# nothing\n", ":1: no joint is named"),
        ("abd,prox,med\n", ": no posture (write"),
        ("abd,prox,med\n0,0\n", ":2: 2 values, the header has 3 (one for each column)"),
        ("abd,prox,med\n0 0 0\n", ":2: 1 values, the header has 3 (separate them by commas)"),
        ("posture,abd,prox,med\n0,0,0\n", ":2: 3 values, the header has 4"),
        ("abd,prox,med\n0,nan,0\n", ":2: prox: 'nan' is not finite (write a plain decimal number)"),
        ("abd,prox,med\n0,-inf,0\n", ":2: prox: '-inf' is not finite"),
        ("abd,prox,med\n0,1e999,0\n", ":2: prox: '1e999' is too large"),
        ("abd,prox,med\n0,,0\n", ":2: prox: is empty"),
        ("abd,prox,med\n0,1_0,0\n", ":2: prox: '1_0' is not a number"),
        ("abd,prox,med\n0,١,0\n", ":2: prox: '١' is not a number"),
        ("abd,prox,med\n0,\"1\n\",0\n", ":2: not a row of comma-separated values"),
        ("posture,abd,prox,med\n,0,0,0\n", ":2: the posture has no name"),
        ("posture,abd,prox,med\nx,0,0,0\nx,0,0,0", ":3: 'x' is in line 2 too (rename one)"),
        ("# unit: mm\nabd,prox,med\n0,0,0\n", ":1: unit 'mm' is not known; write 'rad' or 'deg'"),
        ("# unit:\nabd,prox,med\n0,0,0\n", ":1: unit '' is not known"),
        ("# unit: deg\nabd,prox,med\n# unit: rad\n0,0,0\n", ":3: another unit than in line 1"),
        ("abd,prox,med\n" + "0,0,0\n" * 100_001, ": more than 100000 lines"),
        ("abd,prox,med\n0,0,0\0\n", ":2: a NUL byte"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    assert fault(tmp_path, text).split("\n")[0].startswith(says)


def test_every_faulty_row_is_named_up_to_twenty(tmp_path: Path) -> None:
    says = fault(tmp_path, "abd,prox,med\n0,x,y\n0,0\n9,0,0\n").split("\n")
    assert [line[:3] for line in says] == [":2:", ":2:", ":3:", ":4:"]
    says = fault(tmp_path, "abd,prox,med\n" + "0,x,0\n" * 1000).split("\n")
    assert len(says) == 21 and says[-1] == ": ... and 980 more faults"


def test_a_misspelt_column_is_one_fault(tmp_path: Path) -> None:
    says = fault(tmp_path, "abd,prox,mid\n0,0,0\n")
    assert says == ":1: no joint is called 'mid' (did you mean 'med'?)"


@pytest.mark.parametrize("line", ["# unit: deg,,", "# unit: deg;;", "#units = deg , , "])
def test_a_spreadsheet_fills_the_line_of_the_unit_up(tmp_path: Path, line: str) -> None:
    path = file(tmp_path, f"{line}\nabd,prox,med\n1,2,3\n")
    assert read_postures(path, JOINTS).values[0, 0] == np.deg2rad(1.0)


def test_the_caller_and_the_file_disagree(tmp_path: Path) -> None:
    text = "# unit: deg\nabd,prox,med\n0,0,0\n"
    assert fault(tmp_path, text, unit="rad").startswith(":1: the file says 'deg', the caller 'rad'")


def test_a_table_without_header_is_refused(tmp_path: Path) -> None:
    assert fault(tmp_path, "0,1,2\n0,0,0\n", None).startswith(":1: the header row is missing")


@settings(max_examples=300, deadline=None)
@given(
    st.binary(max_size=120)
    | st.text(st.sampled_from('abd,prox\nme"#unit: 019.e-\r\t\x0b\u2028'), max_size=60).map(
        lambda text: ("# unit: rad\nabd,prox,med\n" + text).encode()
    )
)
def test_any_file_is_read_or_refused(tmp_path_factory: Any, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(data)
    for joints in (JOINTS, None):
        try:
            read = read_postures(path, joints)
        except WbcError as error:
            assert all(line.startswith(str(path)) for line in str(error).splitlines())
        else:
            assert read.values.shape == (len(read.names), len(read.joints))


def test_read_and_project(tmp_path: Path) -> None:
    hand = Synergies.from_table()
    weights = np.deg2rad([[10.0, -20.0, 5.0], [0.0, 0.0, 0.0]])
    rows = [",".join(map(repr, row)) for row in hand.posture(weights).tolist()]
    path = file(tmp_path, "\n".join([",".join(hand.joints), *rows]))
    read = read_postures(path, hand.joints, lower=hand.lower, upper=hand.upper)
    np.testing.assert_allclose(hand.project(read.values), weights, atol=1e-15)

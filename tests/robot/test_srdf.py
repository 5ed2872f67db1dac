"""Pairs of links that an SRDF excludes from collision checking."""

from __future__ import annotations

from pathlib import Path

import pytest

from wbc.errors import UrdfError
from wbc.robot.srdf import disabled_pairs

GOOD = """<?xml version="1.0"?>
<robot name="r">
  <group name="arm"><chain base_link="base" tip_link="tip"/></group>
  <disable_collisions link1="upper" link2="base" reason="Adjacent"/>
  <disable_collisions link1="base" link2="upper" reason="Adjacent"/>
  <disable_collisions link1="tip" link2="upper"/>
</robot>
"""
LINKS = ("base", "upper", "tip")


def _write(folder: Path, text: str) -> Path:
    path = folder / "robot.srdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_reads_each_pair_once(tmp_path: Path) -> None:
    path = _write(tmp_path, GOOD)
    assert disabled_pairs(path) == (("base", "upper"), ("tip", "upper"))
    assert disabled_pairs(path, LINKS) == disabled_pairs(path)


@pytest.mark.parametrize(
    ("old", "new", "line", "phrase"),
    [
        ('link1="tip"', 'link1="tipp"', 6, "unknown link 'tipp' (did you mean 'tip'?)"),
        ('link1="tip" ', "", 6, "<disable_collisions> has no attribute 'link1'"),
        ('link1="tip"', 'link1=""', 6, "is empty"),
        ('link1="tip"', 'link1="upper"', 6, "paired with itself"),
        ('<disable_collisions link1="tip', '<disable_colisions link1="tip', 6, "did you mean"),
        ("</robot>", "", 8, "not well-formed XML"),
        ("<robot", "<!DOCTYPE x>\n<robot", 2, "document types and entities are refused"),
    ],
)
def test_names_line_and_cause(old: str, new: str, line: int, phrase: str, tmp_path: Path) -> None:
    path = _write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(UrdfError) as caught:
        disabled_pairs(path, LINKS)
    (fault,) = str(caught.value).splitlines()
    assert fault.startswith(f"{path}:{line}: ")
    assert phrase in fault


def test_names_all_faults(tmp_path: Path) -> None:
    path = _write(tmp_path, GOOD.replace("upper", "uper"))
    with pytest.raises(UrdfError) as caught:
        disabled_pairs(path, LINKS)
    assert [f.split(":")[1] for f in str(caught.value).splitlines()] == ["4", "5", "6"]


def test_links_are_checked_only_on_request(tmp_path: Path) -> None:
    pairs = disabled_pairs(_write(tmp_path, GOOD.replace("tip", "stranger")))
    assert pairs == (("base", "upper"), ("stranger", "upper"))

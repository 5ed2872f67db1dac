"""The folder of a campaign: what is kept, what is dropped, what is refused."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from wbc.campaign.store import CAMPAIGN, TRIALS, Store
from wbc.errors import WbcError

ABOUT: dict[str, Any] = {
    "scenario": "x", "scenario_sha256": "12ab", "robot_sha256": "34cd", "seed": 3,
    "overrides": {"a.b": "1"}, "varied": {}, "versions": {"wbc": "0", "numpy": "2"},
}  # fmt: skip


def line(number: int) -> str:
    return json.dumps({"trial": number, "seed": 10 * number, "summary": {"success": True}})


def filled(folder: Path, *numbers: int) -> None:
    store = Store(folder, ABOUT)
    for number in numbers:
        store.add(number, line(number))
    store.close()


def test_lines_end_up_in_order(tmp_path: Path) -> None:
    filled(tmp_path / "new", 2, 0, 10, 1)
    text = (tmp_path / "new" / TRIALS).read_text()
    assert text == "".join(line(n) + "\n" for n in (0, 1, 2, 10))
    assert json.loads((tmp_path / "new" / CAMPAIGN).read_text()) == ABOUT


def test_a_line_is_on_disk_before_the_next_trial(tmp_path: Path) -> None:
    store = Store(tmp_path, ABOUT)
    store.add(4, line(4))
    assert (tmp_path / TRIALS).read_text() == line(4) + "\n"
    store.close()


@pytest.mark.parametrize("cut", [1, 10, 1000])
def test_a_torn_last_line_is_dropped_and_what_follows_is_whole(tmp_path: Path, cut: int) -> None:
    filled(tmp_path, 0, 1, 2)
    path = tmp_path / TRIALS
    os.truncate(path, path.stat().st_size - min(cut, len(line(2)) + 1))
    store = Store(tmp_path, ABOUT)
    assert list(store.lines) == [0, 1]
    store.add(3, line(3))
    store.close()
    assert path.read_text() == "".join(line(n) + "\n" for n in (0, 1, 3))


def test_nothing_but_a_torn_line(tmp_path: Path) -> None:
    filled(tmp_path)
    (tmp_path / TRIALS).write_bytes(b'{"trial": 0, "se')
    store = Store(tmp_path, ABOUT)
    assert not store.lines
    store.close()
    assert (tmp_path / TRIALS).read_bytes() == b""


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("seed", 4, "seed 3 there, 4 now"),
        ("overrides", {}, 'overrides {"a.b": "1"} there, {} now'),
        ("varied", {"c": "1 %"}, "varied {} there"),
        ("scenario_sha256", "cd", "its scenario's text differs"),
        ("robot_sha256", "cd", "its robot's description differs"),
        ("versions", {"wbc": "1", "numpy": "2"}, "campaign: wbc 0 there, 1 now ("),
        (
            "versions",
            {"wbc": "0", "mujoco": "3"},
            "mujoco not there, 3 now, numpy 2 there, not now",
        ),
    ],
)
def test_another_campaign_is_refused(tmp_path: Path, key: str, value: Any, said: str) -> None:
    filled(tmp_path, 0)
    with pytest.raises(WbcError) as error:
        Store(tmp_path, {**ABOUT, key: value})
    assert said in str(error.value) and "--out" in str(error.value)
    assert "\n" not in str(error.value)
    assert (tmp_path / TRIALS).read_text() == line(0) + "\n"


def test_a_folder_that_does_not_say_of_which_robot_is_refused(tmp_path: Path) -> None:
    """As those were that were written before it was kept."""
    filled(tmp_path, 0)
    path = tmp_path / CAMPAIGN
    about = json.loads(path.read_text())
    del about["robot_sha256"]
    path.write_text(json.dumps(about))
    with pytest.raises(WbcError, match=r"it does not say of which robot .*delete the folder"):
        Store(tmp_path, ABOUT)


def test_one_at_a_time(tmp_path: Path) -> None:
    store = Store(tmp_path, ABOUT)
    with pytest.raises(WbcError, match="another sweep is at work"):
        Store(tmp_path, ABOUT)
    store.close()
    Store(tmp_path, ABOUT).close()


def test_a_line_that_is_none_is_told_with_its_number(tmp_path: Path) -> None:
    filled(tmp_path, 0)
    with open(tmp_path / TRIALS, "a") as file:
        file.write("[]\n" + line(1) + "\n")
    with pytest.raises(WbcError, match=r"trials\.jsonl:2: is no trial"):
        Store(tmp_path, ABOUT)


def test_trials_of_nobody_knows_what(tmp_path: Path) -> None:
    (tmp_path / TRIALS).write_text(line(0) + "\n")
    with pytest.raises(WbcError, match=r"no campaign\.json"):
        Store(tmp_path, ABOUT)
    (tmp_path / CAMPAIGN).write_text("[1")
    with pytest.raises(WbcError, match="is no campaign of wbc"):
        Store(tmp_path, ABOUT)


def test_a_place_that_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WbcError, match="cannot write to"):
        Store(tmp_path / "file", ABOUT)

"""What docs/sweeps.md says of commands, keys and files is so."""

from __future__ import annotations

import re
import shlex

import pytest

from wbc.campaign import store
from wbc.campaign.figures import wilson
from wbc.cli import parser
from wbc.cli.sweep import LOGS
from wbc.scenario.build_disturbance import ranges_of
from wbc.scenario.disturbance_blocks import Disturbances
from wbc.scenario.located import read_text

from .readme import ROOT

TEXT = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^wbc .*$", TEXT, re.MULTILINE)


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_are_understood(line: str) -> None:
    assert parser().parse_args(shlex.split(line)[1:]).trials


def test_every_key_of_disturbances_is_told() -> None:
    rows = re.findall(r"^\| (`.*?) \|", TEXT, re.MULTILINE)
    told = {name for row in rows for name in re.findall(r"`(\w+)(?:: \[.*?\])?`", row)}
    assert set(Disturbances.model_fields) <= told


def test_the_example_is_read() -> None:
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    block = read_text(example.encode()).data["simulation"]["disturbances"]
    assert ranges_of(Disturbances.model_validate(block)).position == 0.005


def test_files_and_figures() -> None:
    for name in (store.TRIALS, store.REPORT, store.CAMPAIGN, f"{LOGS}/NNNN/"):
        assert f"| `{name}` |" in TEXT
    assert f"{100 * wilson(200, 200).low:.1f} %" in TEXT

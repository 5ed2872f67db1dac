"""The JSON Schema in docs/ is the one the models give, and agrees with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from wbc import resources
from wbc.scenario import json_schema
from wbc.scenario.kinds import COSTS, SURFACES, TASKS
from wbc.scenario.located import read_text

from .hold import COMPLETE

COMMITTED = Path(__file__).resolve().parents[2] / "docs" / "scenario.schema.json"


def test_the_committed_schema_is_current() -> None:
    # Remedy: wbc schema > docs/scenario.schema.json
    assert json.loads(COMMITTED.read_text(encoding="utf-8")) == json_schema()


def test_it_knows_every_type() -> None:
    text = json.dumps(json_schema())
    for name in (*TASKS, *COSTS, *SURFACES):
        assert f'"const": "{name}"' in text


def validator() -> Any:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_the_scenarios_are_valid() -> None:
    judge = validator()
    for name in resources.names("tasks"):
        data = read_text(resources.find("tasks", name).read_bytes()).data
        assert [error.message for error in judge.iter_errors(data)] == []
    assert judge.is_valid(read_text(COMPLETE.encode()).data)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("10 cm", "10 s"),
        ("10 cm", "-1"),
        ("90 deg}\ncontacts", "90}\ncontacts"),
        ("type: circle", "type: cirle"),
        ("urdf:", "udrf:"),
        ("[x, y]", "[x, w]"),
        ("[1, 2 cm, 0]", "[1, 2 cm]"),
        ("'off'", "'of'"),
        ("step: 2 ms", "step: 2 ms, seed: -1"),
        ("delta: 2", "delta: 2 rad"),
    ],
)
def test_what_an_editor_can_see_is_marked(old: str, new: str) -> None:
    assert COMPLETE.count(old) >= 1
    assert not validator().is_valid(read_text(COMPLETE.replace(old, new, 1).encode()).data)

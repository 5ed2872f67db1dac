"""The JSON Schema by which an editor completes and checks a scenario file."""

from __future__ import annotations

from typing import Any

from wbc.scenario.schema import Scenario
from wbc.scenario.units import SHARED


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a scenario file."""
    quantities: dict[str, Any] = {}
    schema = _tidy(Scenario.model_json_schema(), quantities)
    schema["$defs"] = dict(sorted({**schema["$defs"], **quantities}.items()))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "wbc scenario",
        **schema,
    }


def _tidy(node: Any, quantities: dict[str, Any]) -> Any:
    """Without pydantic's titles, which repeat the key, and with every quantity defined once."""
    if isinstance(node, list):
        return [_tidy(item, quantities) for item in node]
    if not isinstance(node, dict):
        return node
    out = {
        key: _tidy(value, quantities)
        for key, value in node.items()
        if not (key == "title" and isinstance(value, str))
    }
    name = out.pop(SHARED, None)
    if name is not None:
        quantities[name] = {key: out.pop(key) for key in ("anyOf", "examples")}
        out = {"$ref": f"#/$defs/{name}", **out}
    return out

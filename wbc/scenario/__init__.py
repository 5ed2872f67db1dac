"""Typed scenario files: `load` checks one by itself, `check_names` against a robot."""

from wbc.scenario.editor import json_schema
from wbc.scenario.load import Loaded, load
from wbc.scenario.names import check_names
from wbc.scenario.schema import Scenario

__all__ = ["Loaded", "Scenario", "check_names", "json_schema", "load"]

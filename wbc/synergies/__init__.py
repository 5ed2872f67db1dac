"""Postural synergies: a hand's joints moved together by a few weights. Needs no robot model."""

from wbc.synergies.consistent import consistent_postures
from wbc.synergies.derived import derived
from wbc.synergies.graspit import read_eigengrasps
from wbc.synergies.postures import Postures, read_postures
from wbc.synergies.reach import Beyond, Reach
from wbc.synergies.synergies import Synergies
from wbc.synergies.tables import Tables, tables, weights_of

__all__ = [
    "Beyond",
    "Postures",
    "Reach",
    "Synergies",
    "Tables",
    "consistent_postures",
    "derived",
    "read_eigengrasps",
    "read_postures",
    "tables",
    "weights_of",
]

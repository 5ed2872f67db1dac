"""Postural synergies: a hand's joints moved together by a few weights. Needs no robot model."""

from wbc.synergies.postures import Postures, read_postures
from wbc.synergies.synergies import Synergies
from wbc.synergies.tables import Tables, tables, weights_of

__all__ = ["Postures", "Synergies", "Tables", "read_postures", "tables", "weights_of"]

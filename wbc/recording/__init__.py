"""The record of a run: log, summary, plots and picture strip.

Plots are in `wbc.recording.plots` and `wbc.recording.strip`, imported where they are drawn:
matplotlib is nothing a run has need of.
"""

from __future__ import annotations

from wbc.recording.log import Log
from wbc.recording.meta import RunMeta, installed_versions
from wbc.recording.outcome import Outcome
from wbc.recording.recorder import Recorder
from wbc.recording.summary import summarize, write

__all__ = [
    "Log",
    "Outcome",
    "Recorder",
    "RunMeta",
    "installed_versions",
    "summarize",
    "write",
]

"""The code in the page about the architecture runs."""

from __future__ import annotations

import re

import numpy as np
import pytest

from .readme import ROOT

TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_pregrasp_and_grasp(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
    scope: dict[str, object] = {}
    exec(compile(example, "architecture.md", "exec"), scope)
    assert float(capsys.readouterr().out.split()[0]) < 1.0  # a rehearsal's tolerance, 1 mm
    pregrasp, grasp = np.asarray(scope["pregrasp"]), np.asarray(scope["grasp"])
    assert 0.0 < np.abs(grasp - pregrasp).max() < 0.5

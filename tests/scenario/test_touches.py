"""A finger that is to touch is led to its contact point by the phase before."""

from __future__ import annotations

from pathlib import Path

import pytest

from wbc import resources
from wbc.errors import ScenarioError
from wbc.scenario import load
from wbc.scenario.touches import check_touches

APPROACH = "    reach: {f3: {clearance: 0 m}, f4: {clearance: 0 m}}"


@pytest.mark.parametrize("name", resources.names("tasks"))
def test_no_scenario_of_ours_closes_a_contact_from_afar(name: str) -> None:
    if not name.endswith(".parts"):
        assert not check_touches(load(name).scenario)


@pytest.mark.parametrize(
    ("reach", "told"),
    [
        ("    reach: {f4: {clearance: 0 m}}", "reaches for nothing there"),
        ("    reach: {f3: {clearance: 8 mm}, f4: {clearance: 0 m}}", "is 8 mm away when"),
        (
            "    reach: {f3: {clearance: 0 m, offset: [0, 1 cm, 0]}, f4: {clearance: 0 m}}",
            "is beside its contact point",
        ),
    ],
)
def test_a_contact_from_afar_has_a_place_and_a_remedy(
    tmp_path: Path, reach: str, told: str
) -> None:
    text = resources.find("tasks", "planar_exchange").read_text(encoding="utf-8")
    assert APPROACH in text
    path = tmp_path / "far.yaml"
    path.write_text(text.replace(APPROACH, reach))
    loaded = load(path)
    with pytest.raises(ScenarioError) as caught:
        raise loaded.error(check_touches(loaded.scenario))
    said = str(caught.value)
    assert "\n" not in said and told in said and "let it reach with clearance 0 m" in said
    assert "far.yaml:" in said and "contacts.f3" in said

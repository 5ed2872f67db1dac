"""The exported file, without a browser."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
import umsgpack

from wbc.errors import WbcError
from wbc.view import write_html

from .demo import demo_scene, demo_snapshot

RUN = [demo_snapshot(3.0 + 0.002 * k) for k in range(2001)]


def data_of(path) -> dict:
    text = path.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="wbc-data">(.*?)</script>', text, re.S)
    return json.loads(found.group(1))


def animation_of(path) -> list:
    last = umsgpack.unpackb(base64.b64decode(data_of(path)["commands"][-1]))
    assert last["type"] == "set_animation"
    return last["animations"]


def values(packed) -> np.ndarray:
    return np.frombuffer(packed.data, dtype="<f4")


def test_the_film_holds_the_run(tmp_path):
    path = write_html(tmp_path / "run.html", demo_scene(), RUN, fps=30)
    assert path.stat().st_size < 3e6
    data = data_of(path)
    assert len(data["times"]) == len(data["states"]) == 121
    assert data["times"][-1] == pytest.approx(4.0)
    clips = {a["path"]: a["clip"]["tracks"] for a in animation_of(path)}
    times, positions = (values(clips["/wbc/object"][0][key]) for key in ("times", "values"))
    expected = 0.2 * np.sin(3.0 + times[:-1])
    np.testing.assert_allclose(positions.reshape(-1, 3)[:-1, 1], expected, atol=1e-6)
    ends = {float(values(t["times"])[-1]) for tracks in clips.values() for t in tracks}
    assert len(ends) == 1, "nodes would repeat out of step"
    assert "/wbc/contacts/f2/point/<object>" in clips


def test_the_same_run_gives_the_same_file(tmp_path):
    one = write_html(tmp_path / "a.html", demo_scene(), RUN[:50]).read_bytes()
    two = write_html(tmp_path / "b.html", demo_scene(), RUN[:50]).read_bytes()
    assert one == two
    assert [p.name for p in sorted(tmp_path.iterdir())] == ["a.html", "b.html"]


def test_a_pose_missing_for_a_while(tmp_path):
    run = [replace(s, contact_points=s.contact_points.copy()) for s in RUN[:500]]
    for s in run[:200]:
        s.contact_points[0] = np.nan
    path = write_html(tmp_path / "run.html", demo_scene(), run)
    clips = {a["path"]: a["clip"]["tracks"] for a in animation_of(path)}
    visible, position, _ = clips["/wbc/contacts/f1/point"]
    assert (visible["name"], visible["values"][0], visible["values"][-1]) == (
        ".visible",
        False,
        True,
    )
    assert np.isfinite(values(position["values"])).all()


def test_one_record_is_a_film(tmp_path):
    assert len(data_of(write_html(tmp_path / "run.html", demo_scene(), RUN[:1]))["times"]) == 1


def test_names_from_files_stay_text(tmp_path):
    evil = "</title></script><script>alert(1)</script>"
    scene = demo_scene(title=evil)
    text = write_html(tmp_path / "run.html", scene, RUN[:5]).read_text(encoding="utf-8")
    assert evil not in text
    assert data_of(tmp_path / "run.html")["info"]["title"] == evil


def test_faults_are_one_line(tmp_path):
    with pytest.raises(WbcError, match="no records"):
        write_html(tmp_path / "run.html", demo_scene(), [])
    with pytest.raises(WbcError, match="cannot write"):
        write_html(tmp_path / "no" / "run.html", demo_scene(), RUN[:2])
    with pytest.raises(WbcError, match="not in order"):
        write_html(tmp_path / "run.html", demo_scene(), RUN[:2][::-1])
    assert list(tmp_path.iterdir()) == []

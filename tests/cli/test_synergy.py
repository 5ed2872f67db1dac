"""``wbc synergy``: from a recorded posture to its weights, to the hand that takes it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from wbc import resources
from wbc.cli import main
from wbc.cli.synergy_files import near_text
from wbc.recording import Log
from wbc.robot.hand import Hand
from wbc.robot.model import load_robot
from wbc.robot.self_distances import self_distances
from wbc.synergies import Synergies, read_postures, tables, weights_of

T = tables()
HAND = Synergies.from_table()


def table(path, values, names=None, unit="deg", joints=T.joints):
    """A file of postures, as a recorder would write it."""
    lines = [f"# unit: {unit}"] if unit else []
    lines.append(",".join([*(["posture"] if names else []), *joints]))
    for k, row in enumerate(np.atleast_2d(values)):
        lines.append(",".join([*([names[k]] if names else []), *(f"{v:.6f}" for v in row)]))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def grasps(*names):
    return np.rad2deg(HAND.posture(np.stack([weights_of(name) for name in names])))


def right_hand():
    return Hand.of(load_robot(resources.find("urdf", "dexmart_hand_right")), T.joints)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_project_prints_the_published_weights(here, capsys):
    assert main(["synergy", "project", table(here / "p.csv", grasps("C27", "G2"), ["a", "b"])]) == 0
    rows = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()}
    assert rows["a"][:4] == ["75.90", "19.80", "-68.00", "0.00"]
    assert rows["b"][:4] == ["-6.61", "8.96", "18.60", "0.00"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("thumb_abd,", "", 1), "2"),
        (lambda text: text.replace("thumb_abd", "thumb", 1), "thumb"),
        (lambda text: text.rsplit(",", 1)[0] + "\n", "14 values"),
        (lambda text: text.rsplit(",", 1)[0] + ",nan\n", "little_med"),
        (lambda text: text.replace("unit: deg", "unit: rad"), "is the unit rad right"),
        (lambda text: text.replace("# unit: deg", ""), "looks like degrees"),
        (lambda text: text.replace("deg", "furlong"), "furlong"),
        (lambda text: "", "empty.csv"),
    ],
    ids=["column-gone", "column-unknown", "short-row", "nan", "degrees-as-radians",
         "no-unit", "unit-unknown", "empty"],
)  # fmt: skip
def test_a_bad_table_is_one_line_with_its_place(here, capsys, change, said):
    path = here / "empty.csv"
    table(path, grasps("C27"))
    path.write_text(change(path.read_text()))
    for command in ("project", "grasp"):
        assert main(["synergy", command, "empty.csv"]) == 2
        error = capsys.readouterr().err
        assert error.startswith("empty.csv:")
        assert said in error
        assert "Traceback" not in error
    assert not (here / "runs").exists()


def test_tables_are_computed_and_written_whole(here, capsys):
    assert main(["synergy", "tables", "--out", "out"]) == 0
    data = json.loads((here / "out/tables.json").read_text())
    assert np.round(data["sigma"], 3).tolist() == [0.599, 0.772, 0.850]
    assert np.shape(data["postures_deg"]) == (41, 15)
    assert np.shape(data["alpha"]) == (41, 3)
    assert np.abs(np.array(data["table3_two_syn"]) - T.thumb_errors[:, 0]).max() <= 0.05
    assert np.abs(np.array(data["table4_two_syn"]) - T.errors[:, 0]).max() <= 0.01
    assert len(data["beyond_limits"]) == 17
    said = capsys.readouterr().out
    assert "C34" in said and "thumb_med -23.3 deg" in said
    for name in (*T.names, *T.new_names):
        assert set(data["self_distance"][name]) == {"mm", "links"}
    # what was written can be read again, and gives back the synergies that it was made from
    assert main(["synergy", "fit", "out/consistent.csv", "--out", "hand.json"]) == 0
    fitted = Synergies.load("hand.json")
    assert np.abs(fitted.basis - T.basis).max() < 6e-3  # one printed entry has two digits swapped
    assert np.abs(np.rad2deg(fitted.mean) - T.mean).max() < 0.05
    assert abs(fitted.explained[2] - 0.8503) < 1e-4
    commanded = read_postures("out/commanded.csv", T.joints)
    alpha = np.stack([weights_of(name) for name in commanded.names])
    assert np.abs(commanded.values - HAND.command(alpha)).max() < 1e-6
    nearest = self_distances(right_hand(), commanded.values)
    found = [data["self_distance"][name]["mm"] for name in commanded.names]
    assert np.abs(np.array(found) - [1e3 * near.distance for near in nearest]).max() < 2e-3
    assert main(["synergy", "project", "out/postures.csv"]) == 0
    assert "thumb_med is 23.3 deg below its range: clipped" in capsys.readouterr().out  # C34


def test_the_reach_ends_in_the_commanded_posture(here, capsys):
    assert main(["synergy", "grasp", "C34", "--out", "out"]) == 0
    assert "thumb_med would go 23.3 deg below its range" in capsys.readouterr().out
    log = Log.load("out/log.npz")
    order = [log.joint_names.index(joint) for joint in T.joints]
    assert np.abs(log.q[-1, order] - HAND.command(weights_of("C34"))).max() < 1e-6


def test_a_posture_that_was_shown_is_taken(here, capsys):
    """Teaching by showing: recorded joint values, their weights, the hand that takes them."""
    shown = grasps("G3")[0] + 0.5 * np.cos(np.arange(15))
    path = table(here / "shown.csv", np.stack([shown, shown - 1.0]), ["mug", "cup"])
    assert main(["synergy", "grasp", path]) == 2
    assert "choose one" in capsys.readouterr().err
    assert main(["synergy", "grasp", f"{path}:mug", "--path", "smooth"]) == 0
    log = Log.load("runs/synergy_mug/log.npz")
    order = [log.joint_names.index(joint) for joint in T.joints]
    at = int(np.argmin(np.abs(log.t - 0.75)))  # a tenth of the way to the open hand, not a quarter
    here = HAND.project(log.q[at, order]) / HAND.project(np.zeros(15))
    assert np.abs(here - 0.1035).max() < 0.06
    goal = HAND.command(HAND.project(np.deg2rad(shown)))
    assert np.abs(log.q[-1, order] - goal).max() < 1e-6


def test_show_goes_from_end_to_end_of_a_synergy(here, capsys):
    assert main(["synergy", "show", "e3"]) == 0
    assert "thumb_abd" in capsys.readouterr().out
    log = Log.load("runs/synergy_e3/log.npz")
    order = [log.joint_names.index(joint) for joint in T.joints]
    weights = HAND.project(log.q[:, order])
    least, largest = HAND.ranges()[2]
    assert abs(weights[:, 2].min() - least) < 1e-3
    assert abs(weights[:, 2].max() - largest) < 1e-3
    assert np.abs(weights[:, :2]).max() < 1e-9


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["grasp", "C37"], "unknown grasp 'C37'"),
        (["grasp", "noext"], "POSTURE.csv"),
        (["grasp", "C27", "--hand", "planar_gripper"], "no joint 'thumb_abd'"),
        (["grasp", "C27", "--hand", "dual_arm"], "no joint 'thumb_abd'"),
        (["grasp", "C27", "--synergies", "none.json"], "none.json"),
        (["show", "e4"], "unknown synergy 'e4'"),
        (["project", "none.csv"], "none.csv"),
        (["fit", "none.csv", "--out", "x.json"], "none.csv"),
        (["import", "none.xml", "--joints", "a", "--out", "x.json"], "none.xml"),
    ],
)
def test_what_is_not_there_is_one_line(here, capsys, arguments, said):
    assert main(["synergy", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("row", ["../../out/mug", "mug: of tea/1", "z" * 300])
def test_a_name_in_a_file_does_not_say_where_to_write(tmp_path, monkeypatch, row):
    home = tmp_path / "home" / "here"
    home.mkdir(parents=True)
    monkeypatch.chdir(home)
    path = table(home / "P.CSV", grasps("C2"), [row])
    assert main(["synergy", "grasp", f"{path}:{row}"]) == 0
    (run,) = (home / "runs").iterdir()
    assert (run / "log.npz").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["home"]
    assert {p.name for p in home.iterdir()} == {"P.CSV", "runs"}


def test_any_name_of_a_file_is_taken(here):
    folder = here / "my hand #1: 🙂"
    folder.mkdir()
    HAND.save(folder / "h, [a].json")
    given = ["--synergies", str(folder / "h, [a].json"), "--out", "out"]
    assert main(["synergy", "grasp", "zero_offset", *given]) == 0


@pytest.mark.parametrize(("weight", "side"), [(3.5, "above"), (-3.0, "below")])
def test_the_limits_of_the_robot_count_where_synergies_know_no_ranges(here, capsys, weight, side):
    replace(HAND, lower=np.full(15, -np.inf), upper=np.full(15, np.inf)).save("hand.json")
    path = table(here / "p.csv", HAND.mean + HAND.basis @ [weight, 0.0, 0.0], unit="rad")
    assert main(["synergy", "grasp", path, "--synergies", "hand.json", "--out", "out"]) == 0
    said = capsys.readouterr().out
    log = Log.load("out/log.npz")
    order = [log.joint_names.index(joint) for joint in T.joints]
    (near,) = self_distances(right_hand(), log.q[-1:, order])
    assert f"{side} its range" in said
    assert near_text(near) in said


EIGENGRASPS = """<?xml version="1.0" ?>
<EigenGrasps dimensions="2">
  <EG><EigenValue value="0.7"/><DimVals d0="1" d1="1"/></EG>
  <ORIGIN><DimVals d0="0.5" d1="0.25"/></ORIGIN>
</EigenGrasps>
"""


def test_another_hand_from_a_file_of_graspit(here):
    (here / "hand.xml").write_text(EIGENGRASPS)
    out = ["--joints", "left_a_1, left_a_2", "--out", "hand.json"]
    assert main(["synergy", "import", "hand.xml", *out]) == 0
    found = Synergies.load("hand.json")
    assert found.joints == ("left_a_1", "left_a_2")
    assert found.mean.tolist() == [0.5, 0.25]


def test_another_hand_moves(here):
    """Synergies fitted to two joints of another robot are shown on it."""
    values = np.deg2rad([[10, 20], [20, 45], [30, 58]])
    joints = ("left_a_1", "left_a_2")
    path = table(here / "p.csv", values, unit="rad", joints=joints)
    assert main(["synergy", "fit", path, "--count", "1", "--hand", "planar_bimanual",
                 "--out", "hand.json"]) == 0  # fmt: skip
    other = ["--synergies", "hand.json", "--hand", "planar_bimanual"]
    assert main(["synergy", "show", "e1", *other]) == 0
    assert Log.load("runs/synergy_e1/log.npz").complete


def test_weights_can_be_typed(here, capsys):
    assert main(["synergy", "grasp", "75.9, 19.8,-68 deg", "--out", "typed"]) == 0
    assert main(["synergy", "grasp", "C27", "--out", "named"]) == 0
    assert "weights 75.9, 19.8, -68 deg" in capsys.readouterr().out
    typed, named = Log.load("typed/log.npz"), Log.load("named/log.npz")
    assert np.abs(typed.q - named.q).max() < 1e-12
    for wrong in ("1,2", "1,2,x", "1,2,3,4", "1,2,nan", "1e9,2,3"):
        assert main(["synergy", "grasp", wrong]) == 2
        assert capsys.readouterr().err.startswith(f"'{wrong}'")


def test_what_a_robot_lacks_is_told_with_the_remedy(here, capsys):
    assert main(["synergy", "show", "e1", "--hand", "dual_arm"]) == 2
    assert "(give --prefix left_ or right_)" in capsys.readouterr().err
    assert main(["synergy", "show", "e1", "--hand", "planar_gripper"]) == 2
    assert "(give another --hand)" in capsys.readouterr().err


def test_fit_refuses_what_the_hand_cannot_have(here, capsys):
    path = table(here / "p.csv", np.array([[10, 20], [20, 45], [30, 58]]), unit="",
                 joints=("left_a_1", "left_a_2"))  # fmt: skip
    given = ["fit", path, "--hand", "planar_bimanual", "--count", "1", "--out", "hand.json"]
    assert main(["synergy", *given]) == 2
    assert "looks like degrees" in capsys.readouterr().err
    path = table(here / "q.csv", np.zeros((3, 2)), joints=("a", "b"))
    assert main(["synergy", "fit", path, "--out", "hand.json"]) == 2
    assert capsys.readouterr().err.startswith(f"{path}: 3 postures")
    assert not (here / "hand.json").exists()

"""``wbc sweep``: the same lines however they came about, and nothing lost that was done."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wbc import resources
from wbc.campaign.trial import Trial, trial_seed
from wbc.campaign.vary import drawn, read_variations
from wbc.cli import main
from wbc.cli import sweep as command
from wbc.cli.trial import run_trial
from wbc.recording import Log
from wbc.scenario import load
from wbc.sim.disturbances import Ranges, draw

from . import light
from .shell import SHORT, children, finish, gone, start, wbc

TRIALS = 6
VARY = ("--vary", "object.pose.position[0]=2 mm", "--vary", "simulation.duration=50 %")
WHAT = ("sweep", "planar_exchange", "--trials", str(TRIALS), *SHORT, *VARY)
DISTURBED = "simulation.disturbances={mass: 30 %, friction: 30 %, size: 1 %, force_noise: 5 %}"
HUNDRED = (
    "sweep", "planar_exchange_dynamic", "--trials", "100", *SHORT, "--set", DISTURBED,
    "--keep", "none", "--out", "out",
)  # fmt: skip


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A sweep by one worker, with all logs, and what it said."""
    folder = tmp_path_factory.mktemp("reference")
    done = wbc(*WHAT, "--workers", "1", "--keep", "all", "--out", "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "out", done.stdout


def lines(folder: Path) -> bytes:
    return (folder / "trials.jsonl").read_bytes()


def trials(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in lines(folder).splitlines()]


def test_a_line_is_a_function_of_scenario_settings_and_seed(reference: tuple[Path, str]) -> None:
    """Run again in this process, in another order."""
    settings = {"simulation.duration": "0.2"}
    loaded = load("planar_exchange", settings)
    variations = read_variations(VARY[1::2], loaded)
    found = {}
    for number in reversed(range(TRIALS)):
        seed = trial_seed(0, number)
        overrides, varied = drawn(variations, seed)
        found[number] = run_trial(
            Trial(
                number, seed, loaded.text.encode(), loaded.path, "shown",
                {**settings, **overrides, "simulation.seed": seed}, varied, Path("no"), "none",
            )
        ).line  # fmt: skip
    assert lines(reference[0]).decode() == "".join(found[n] + "\n" for n in range(TRIALS))


def test_what_a_line_holds(reference: tuple[Path, str]) -> None:
    found = trials(reference[0])
    assert [t["trial"] for t in found] == list(range(TRIALS))
    assert [t["seed"] for t in found] == [trial_seed(0, n) for n in range(TRIALS)]
    for trial in found:
        assert set(trial) == {"trial", "seed", "disturbance", "summary"}
        assert set(trial["disturbance"]) == {"object.pose.position[0]", "simulation.duration"}
        ticks = round(trial["disturbance"]["simulation.duration"] / 0.002)
        assert trial["summary"]["ticks"] == ticks
        assert not {"versions", "source", "seed"} & set(trial["summary"])
    assert len({t["summary"]["ticks"] for t in found}) > 4


def test_two_workers_and_one_of_them_killed(reference: tuple[Path, str], tmp_path: Path) -> None:
    process = start(*WHAT, "--workers", "2", "--keep", "none", "--out", "out", cwd=tmp_path)
    wait_for_lines(tmp_path / "out", 1, process)
    victims = workers(process.pid)
    os.kill(victims[0], signal.SIGKILL)
    _, errors = finish(process)
    assert process.returncode == 0, errors
    assert lines(tmp_path / "out") == lines(reference[0])
    assert not (tmp_path / "out/trials").exists()
    assert "Traceback" not in errors


def test_killed_as_a_whole_it_goes_on_where_it_was(
    reference: tuple[Path, str], tmp_path: Path
) -> None:
    process = start(*WHAT, "--workers", "2", "--out", "out", cwd=tmp_path)
    wait_for_lines(tmp_path / "out", 2, process)
    left = workers(process.pid)
    process.send_signal(signal.SIGKILL)
    finish(process)
    assert gone(left)
    path = tmp_path / "out/trials.jsonl"
    before = path.read_bytes().splitlines()
    with open(path, "ab") as file:
        file.write(b'{"trial": 5, "seed": 12, "distur')
    assert main([*WHAT, "--workers", "2", "--out", str(tmp_path / "out")]) == 0
    assert lines(tmp_path / "out") == lines(reference[0])
    assert set(before) <= set(lines(tmp_path / "out").splitlines())


def test_ctrl_c_keeps_what_is_there(reference: tuple[Path, str], tmp_path: Path) -> None:
    process = start(*WHAT, "--workers", "1", "--out", "out", cwd=tmp_path)
    wait_for_lines(tmp_path / "out", 1, process)
    left = workers(process.pid)
    for pid in (*left, process.pid):  # as a terminal does
        os.kill(pid, signal.SIGINT)
    out, errors = finish(process)
    assert process.returncode == 130
    assert errors == "interrupted: the same command goes on from here\n"
    assert gone(left)
    found = trials(tmp_path / "out")
    assert 1 <= len(found) < TRIALS
    assert f"0 of {len(found)}" in out
    assert f"0 of {len(found)}" in (tmp_path / "out/report.html").read_text()
    assert set(lines(tmp_path / "out").splitlines()) < set(lines(reference[0]).splitlines())


def test_a_trial_that_crashes_is_a_failure_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "run_trial", light.light_or_crash)
    for count in ("1", "2"):
        assert main([*WHAT, "--workers", count, "--out", str(tmp_path / count)]) == 0
        assert_crashed(tmp_path / count)
    assert lines(tmp_path / "1") == lines(tmp_path / "2")


def assert_crashed(folder: Path) -> None:
    """One trial has crashed, all others have not."""
    for number, found in enumerate(trials(folder)):
        crashed = number == light.CRASHES
        assert (found["trial"], found["seed"]) == (number, trial_seed(0, number))
        assert len(found["disturbance"]) == 2
        assert found["summary"] == {
            "success": not crashed, "reason": "crashed" if crashed else "",
        }  # fmt: skip


def test_more_trials_are_added_and_fewer_take_none_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run_trial", light.light)
    few = [*WHAT[:3], "3", *WHAT[4:], "--workers", "2", "--out", str(tmp_path)]
    assert main(few) == 0
    three = lines(tmp_path)
    assert three.count(b"\n") == 3
    capsys.readouterr()
    assert main([*WHAT, "--workers", "2", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("3 trials are there already\n")
    every = lines(tmp_path)
    assert every.startswith(three) and every.count(b"\n") == TRIALS
    assert main(few) == 0
    assert lines(tmp_path) == every


def test_what_is_said(reference: tuple[Path, str]) -> None:
    said = reference[1].splitlines()
    assert said[0].startswith(f"success        0 of {TRIALS}, 0.0 % (95 % confidence: 0.0 to ")
    first = "not_finished in phase 'approach' (first: trial 0)"
    assert " ".join(said[1].split()) == f"{TRIALS} {first}"
    assert said[-1] == "written to out: trials.jsonl, report.html"
    page = (reference[0] / "report.html").read_text()
    assert f"planar_exchange: {TRIALS} trials" in page
    assert "object.pose.position[0]=" not in page and "object.pose.position[0]: 2 mm" in page


def test_a_kept_log_can_be_seen_and_run_again(reference: tuple[Path, str], tmp_path: Path) -> None:
    kept = reference[0] / "trials/0003"
    log = Log.load(kept / "log.npz")
    assert log.ticks == trials(reference[0])[3]["summary"]["ticks"]
    assert main(["view", str(kept), "--html", str(tmp_path / "view.html")]) == 0
    assert (tmp_path / "view.html").stat().st_size > 10_000
    assert main(["run", str(kept / "scenario.yaml"), "--out", str(tmp_path / "again")]) == 1
    assert (Log.load(tmp_path / "again/log.npz").q == log.q).all()


BAD: list[tuple[list[str], str]] = [
    (["--trials", "0"], "'0' is no number of them"),
    (["--trials", "-3"], "'-3' is no number of them"),
    (["--workers", "two"], "'two' is no number of them"),
    (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "not allowed with"),
    (["--keep", "some"], "invalid choice"),
    (["--seed", "-1"], "must be at least 0"),
    (["--set", "simulation.duration"], "write KEY=VALUE"),
    (["--vary", "object.mass"], "write KEY=RANGE"),
    (["--vary", "object.mass=10 %"], "no such value"),
    (["--out", "/dev/null/here"], "cannot write to"),
    (["--set", "simulation.disturbances={mass: 10 %}"], "needs 'simulation.engine"),
]


@pytest.mark.parametrize(("arguments", "why"), BAD, ids=[" ".join(a) for a, _ in BAD])
def test_bad_arguments_are_one_line(
    arguments: list[str],
    why: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code: Any = main(["sweep", "planar_exchange", *VARY, *arguments])
    except SystemExit as error:
        code = error.code
    said = capsys.readouterr().err.splitlines()
    assert code == 2
    assert why in said[-1]
    assert len(said) == 1 or said[0].startswith("usage:")
    assert list(tmp_path.iterdir()) == []


def test_another_campaign_in_the_folder_is_one_line(
    reference: tuple[Path, str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = lines(reference[0])
    assert main([*WHAT, "--seed", "1", "--out", str(reference[0])]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "seed 0 there, 1 now (choose another --out" in said[0]
    assert lines(reference[0]) == before


def test_another_robot_and_other_versions_are_one_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "run_trial", light.light)
    loaded = load("planar_exchange")
    file, urdf = tmp_path / "mine.yaml", tmp_path / "mine.urdf"
    text = resources.find("urdf", loaded.scenario.robot.urdf).read_text()
    urdf.write_text(text)
    file.write_text(loaded.text)
    what = [
        "sweep", str(file), "--set", f"robot.urdf={urdf}", *VARY, "--trials", "2",
        "--workers", "1", "--out", str(tmp_path / "out"),
    ]  # fmt: skip
    assert main(what) == 0
    capsys.readouterr()
    versions = command.installed_versions()
    monkeypatch.setattr(command, "installed_versions", lambda: {**versions, "numpy": "0.1"})
    assert main(what) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and f"numpy {versions['numpy']} there, 0.1 now (choose" in said[0]
    monkeypatch.undo()
    urdf.write_text(text.replace("<robot", "<!-- weighed again --><robot", 1))
    assert main(what) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "its robot's description differs (choose" in said[0]
    assert len(trials(tmp_path / "out")) == 2


def test_a_trial_that_cannot_start_is_a_failure_with_its_reason(tmp_path: Path) -> None:
    loaded = load("planar_exchange")
    trial = Trial(
        0, 1, loaded.text.encode(), loaded.path, "it.yaml",
        {"object.pose.position": [5.0, 0.0]}, {}, tmp_path, "all",
    )  # fmt: skip
    summary = json.loads(run_trial(trial).line)["summary"]
    assert summary["success"] is False
    assert summary["reason"].startswith("refused: it.yaml: ")
    assert str(Path.cwd()) not in summary["reason"]


def test_what_is_drawn_is_in_the_line_and_in_the_summary(tmp_path: Path) -> None:
    loaded = load("planar_exchange_dynamic")
    settings = {
        "simulation.duration": "10 ms",
        "simulation.disturbances": "{mass: 30 %, position: 1 mm, delay: 3 ms}",
        "simulation.seed": 77,
    }
    trial = Trial(
        0, 77, loaded.text.encode(), loaded.path, "it.yaml", settings, {}, tmp_path, "all"
    )
    expected = draw(Ranges(mass=0.3, position=0.001, delay=0.003), 77, planar=True).as_record()
    expected = json.loads(json.dumps(expected))
    line = json.loads(run_trial(trial).line)
    assert line["disturbance"] == expected
    assert "disturbance" not in line["summary"]
    assert json.loads((tmp_path / "summary.json").read_text())["disturbance"] == expected


def test_without_dask_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    address = ("--scheduler", "tcp://127.0.0.1:1", "--out", str(tmp_path / "out"))
    assert main([*WHAT, *address]) == 2
    assert capsys.readouterr().err == (
        "--scheduler needs dask.distributed, which is not installed: pip install 'wbc[sweep]'\n"
    )
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
    ) as local:  # fmt: skip
        yield local


def test_dask_gives_the_same_lines_also_when_a_worker_is_killed(
    reference: tuple[Path, str], tmp_path: Path, cluster: Any
) -> None:
    at = ("--scheduler", cluster.scheduler_address)
    process = start(*WHAT, *at, "--keep", "none", "--out", "out", cwd=tmp_path)
    wait_for_lines(tmp_path / "out", 1, process)
    os.kill(cluster.workers[0].pid, signal.SIGKILL)
    _, errors = finish(process)
    assert process.returncode == 0, errors
    assert lines(tmp_path / "out") == lines(reference[0])


def test_dask_with_a_trial_that_crashes(
    tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "run_trial", light.light_or_crash)
    assert main([*WHAT, "--scheduler", cluster.scheduler_address, "--out", str(tmp_path)]) == 0
    assert_crashed(tmp_path)


@pytest.fixture(scope="module")
def hundred(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A hundred disturbed trials under torques by one worker."""
    folder = tmp_path_factory.mktemp("hundred")
    done = wbc(*HUNDRED, "--workers", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    table = lines(folder / "out")
    assert table.count(b"\n") == 100 and b"crashed" not in table
    return table


@pytest.mark.slow
@pytest.mark.parametrize("kills", [False, True])
def test_a_hundred_trials_by_two_workers(hundred: bytes, tmp_path: Path, kills: bool) -> None:
    process = start(*HUNDRED, "--workers", "2", cwd=tmp_path)
    if kills:
        wait_for_lines(tmp_path / "out", 30, process)
        os.kill(workers(process.pid)[0], signal.SIGKILL)
    _, errors = finish(process)
    assert process.returncode == 0, errors
    assert lines(tmp_path / "out") == hundred


@pytest.mark.slow
def test_a_hundred_trials_by_dask(hundred: bytes, tmp_path: Path, cluster: Any) -> None:
    process = start(*HUNDRED, "--scheduler", cluster.scheduler_address, cwd=tmp_path)
    wait_for_lines(tmp_path / "out", 30, process)
    os.kill(cluster.workers[1].pid, signal.SIGKILL)
    _, errors = finish(process)
    assert process.returncode == 0, errors
    assert lines(tmp_path / "out") == hundred


def test_nobody_at_the_address(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    from wbc.campaign import cluster as dask

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dask, "_CONNECT", 0.5)
        assert main([*WHAT, "--scheduler", "tcp://127.0.0.1:1", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "tcp://127.0.0.1:1: cannot be reached" in said


def wait_for_lines(folder: Path, count: int, process: subprocess.Popen[str]) -> None:
    path = folder / "trials.jsonl"
    while process.poll() is None:
        with contextlib.suppress(OSError):
            if path.read_bytes().count(b"\n") >= count:
                return
        time.sleep(0.01)
    raise AssertionError(process.communicate())


def workers(pid: int) -> list[int]:
    """The processes that run trials; one more keeps their books."""
    found = []
    for child in children(pid):
        with contextlib.suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    assert found
    return found

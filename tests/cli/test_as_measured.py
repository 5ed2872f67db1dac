"""Figures 15, 17 and 18 of a run under torques: errors, residuals and tasks as measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from wbc.cli.as_measured import as_measured
from wbc.cli.pictures import with_table
from wbc.cli.replay import open_film
from wbc.cli.run import _truly
from wbc.cli.session import run_meta
from wbc.contact.grasp import Grasp
from wbc.recording import Log, Recorder
from wbc.recording.dynamic_facts import object_error_true
from wbc.robot.model import RobotModel
from wbc.rotations import exp_so3, quaternion, rotation_from_quaternion
from wbc.scenario import Scenario, load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic, kinematic
from wbc.view.from_robot import SnapshotMaker, robot_scene

FIGURES = ("object_error", "eps_f", "eps_m", "task_error")


def run(name: str, ticks: int) -> tuple[Log, Scenario, RobotModel, Grasp]:
    """The first ticks of the ideal robot, as if torques had moved it exactly so."""
    assembly = build(load(name))
    recorder = Recorder(run_meta(assembly), ticks)
    for record, _ in kinematic.run(assembly.controller, assembly.start, ticks):
        recorder.append(record)
    log = recorder.finish()
    log = replace(log, q_meas=log.q, v_meas=log.v, tau=log.q, object_pose_true=log.object_pose)
    grasp = assembly.controller.law.kin.grasp
    return log, assembly.loaded.scenario, assembly.model, grasp


@pytest.fixture(scope="module", params=["planar_exchange", "in_hand_sliding"])
def exact(request):
    """In the plane fingers hold and come, in space some hold and two slide."""
    return run(request.param, 150)


def test_where_everything_is_as_commanded_the_figures_are_the_first_stages(exact) -> None:
    log, *world = exact
    found = as_measured(log, *world)
    assert np.isfinite(log.object_error).any()
    for name in FIGURES:
        np.testing.assert_allclose(
            getattr(found, name), getattr(log, name), rtol=1e-7, atol=2e-9, err_msg=name
        )


def test_a_joint_that_is_elsewhere_moves_the_object_of_its_finger_only(exact) -> None:
    """Rigidly with the tip: contact variables are as commanded."""
    log, scenario, model, grasp = exact
    i = int(np.flatnonzero(log.in_contact[7])[0])
    tip = model.frame(scenario.robot.fingers[grasp.fingers[i]])
    q = log.q.copy()
    q[:, int(np.flatnonzero(model.support(tip))[-1])] += 1e-3
    found = as_measured(replace(log, q_meas=q), scenario, model, grasp)
    data, places = model.pin_model.createData(), []
    for at in (log.q[7], q[7]):
        pin.framesForwardKinematics(model.pin_model, data, model.full(at))
        places.append(pin.SE3(data.oMf[tip]))
    moved = places[1] * places[0].inverse()
    away = moved.act(log.object_pose[7, :3]) - log.object_pose_ref[7, :3]
    turned = np.linalg.norm(pin.log3(moved.rotation))
    assert found.object_error[7, i] == pytest.approx((np.linalg.norm(away), turned), rel=2e-3)
    others = [k for k in np.flatnonzero(log.in_contact[7]) if k != i]
    np.testing.assert_allclose(
        found.object_error[7, others], log.object_error[7, others], atol=2e-9
    )


def test_the_residuals_are_those_of_the_true_contacts(exact) -> None:
    """An object displaced in the hand is touched elsewhere; one that is not, is not."""
    log, *world = exact
    turn = exp_so3(np.array([0.0, 0.0, 0.02]))
    pose = log.object_pose + np.array([2e-3, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
    for row in pose:
        row[3:] = quaternion(rotation_from_quaternion(row[3:]) @ turn)
    found = as_measured(replace(log, object_pose_true=pose), *world)
    assert np.abs(found.eps_f - log.eps_f).max() > 1e-5
    still = as_measured(replace(log, object_pose_true=log.object_pose), *world)
    np.testing.assert_allclose(still.eps_f, log.eps_f, atol=2e-9)


def test_what_is_not_finite_is_left_out(exact) -> None:
    log, *world = exact
    q = log.q.copy()
    q[40:] = np.nan
    found = as_measured(replace(log, q_meas=q), *world)
    assert np.isnan(found.eps_f[40:]).all() and np.isfinite(found.eps_f[:40]).all()
    assert np.isnan(found.object_error[40:]).all()


def test_the_panel_shows_the_true_object_and_what_gave_way_live_and_again(tmp_path) -> None:
    """Pushed too hard to be held: the object is lost, whatever the references say."""
    push = "{pushes: [{at: 0.1 s, force: [300 N, 0 N, 0 N], over: 0.4 s}]}"
    settings = {"simulation.disturbances": push, "simulation.duration": "0.6 s"}
    assembly = build(load("planar_exchange_dynamic", settings))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    recorder = Recorder(run_meta(assembly, dynamics), assembly.ticks)
    ticks = dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics)
    records = [record for record, _ in ticks]
    for record in records:
        recorder.append(record)
    log = recorder.finish()
    log.save(tmp_path / "log.npz")
    last = len(records) - 1
    shot = SnapshotMaker(assembly.model).of_record(_truly(records[last], records[0]))
    film = open_film(str(tmp_path))
    again = next(film.snapshots([last]))
    way, angle = object_error_true(log)
    assert way[last] > 0.05
    assert shot.error == pytest.approx((way[last], angle[last]))
    assert again.error == pytest.approx(shot.error)
    assert again.status == shot.status and "contact lost" in shot.status


def test_the_picture_has_the_table_with_posts_up_to_the_object() -> None:
    assembly = build(load("dual_arm_exchange_mujoco"))
    scenario, grasp = assembly.loaded.scenario, assembly.controller.law.kin.grasp
    bare = robot_scene(assembly.model, grasp, title="")
    top, *posts = with_table(bare, scenario, grasp).shapes[len(bare.shapes) :]
    table, thing = scenario.simulation.physics.table, scenario.object
    assert table is not None and thing is not None and table.height is not None
    assert top.placement[2, 3] + 0.5 * top.size[2] == pytest.approx(table.height)
    assert len(posts) == 4
    for post, across in zip(posts, table.posts, strict=True):
        assert post.placement[:2, 3] == pytest.approx(np.array(thing.pose.xyz[:2]) + across)
        middle, half = post.placement[2, 3], 0.5 * post.size[2]
        assert middle - half == pytest.approx(table.height)
        assert table.height + 0.1 < middle + half < thing.pose.xyz[2]
    ideal = build(load("planar_exchange_dynamic"))
    assert with_table(bare, ideal.loaded.scenario, grasp) is bare

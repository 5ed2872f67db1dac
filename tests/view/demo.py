"""A scene made by hand: two boxes that carry a rounded triangle, without any robot."""

from __future__ import annotations

import numpy as np

from wbc.view import ObjectShape, Scene, SceneShape, Snapshot, extrude

BODIES = ("left", "right")
CONTACTS = ("f1", "f2")
TASKS = ("object pose", "equilibrium", "manipulability f1", "posture")
PHASES = ("approach", "co-grasp", "leave")


def contour(n: int = 60, radius: float = 0.1) -> np.ndarray:
    """A rounded triangle, counter-clockwise."""
    angle = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    r = radius * (1.0 + 0.12 * np.cos(3 * angle))
    return np.column_stack((r * np.cos(angle), r * np.sin(angle)))


def demo_scene(planar: bool = True, title: str = "two boxes") -> Scene:
    line = contour()
    vertices, triangles = extrude(line, -0.02, 0.02)
    outline = np.column_stack((line, np.zeros(len(line))))
    shapes = [SceneShape("base", "box", None, (0.9, 0.03, 0.03), placement=shifted(0, -0.3, 0))]
    for body, contact in zip(BODIES, CONTACTS, strict=True):
        shapes += [
            SceneShape("palm", "box", body, (0.06, 0.16, 0.04), rgba=(0.36, 0.45, 0.60, 1.0)),
            SceneShape("arm", "cylinder", body, (0.015, 0.25), placement=shifted(0, 0, 0.1)),
            SceneShape(
                "tip",
                "sphere",
                body,
                (0.025,),
                placement=shifted(0, 0.09, 0),
                finger=contact,
            ),
            SceneShape("finger", "capsule", body, (0.012, 0.06), placement=shifted(0, -0.09, 0)),
        ]
    return Scene(
        title=title,
        shapes=tuple(shapes),
        object=ObjectShape(vertices, triangles, outline=outline),
        body_names=BODIES,
        contact_names=CONTACTS,
        task_names=TASKS,
        phase_names=PHASES,
        planar=planar,
        extent=0.5,
    )


def shifted(x: float, y: float, z: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def demo_snapshot(t: float, matrices: bool = False) -> Snapshot:
    """The object goes up and down between the boxes; the second contact is lost half the time."""
    y, turn = 0.2 * np.sin(t), 0.4 * np.sin(0.7 * t)
    pose = np.array([0.0, y, 0.0, 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2)])
    upright = (0.0, 0.0, 0.0, 1.0)
    bodies = np.array([(-0.15, y, 0.0, *upright), (0.15, y, 0.0, *upright)])
    if matrices:
        bodies = np.stack([shifted(*b[:3]) for b in bodies])
    touching = np.sin(2 * t) >= 0.0
    return Snapshot(
        t=t,
        bodies=bodies,
        object_pose=pose,
        contact_points=np.array([(-0.11, y, 0.0), (0.11, y, 0.0)]),
        contact_normals=np.array([(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]),
        contact_mode=np.array([1, 2 * int(touching)]),
        in_stack=np.array([True, True, touching, False]),
        activation=np.array([1.0, 1.0, 0.5 + 0.5 * np.sin(2 * t), 0.1]),
        phase=int(t) % 3,
        eps_f=10.0 ** (-1 - t),
        eps_m=10.0 ** (-2 - t),
        error=(1e-6 * t, 2e-6 * t),
        distance=0.01 + 0.001 * t,
        status="slowed by limits",
        text="posture left the stack at 0.42 s",
    )

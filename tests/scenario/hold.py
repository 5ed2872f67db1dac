"""A complete scenario to break."""

COMPLETE = """\
name: hold
robot:
  urdf: planar_bimanual
  fingers: {f1: tip_1, f2: tip_2}
  start: {j1: 10 deg, j2: 5 cm}
object:
  surface: {type: circle, radius: 10 cm}
  pose: {position: [0, 0.5], angle: 90 deg}
contacts:
  f1: {at: [0]}
  f2: {at: [180 deg]}
tasks:
  main: {type: object_pose, gain: 50 /s}
  wrist: {type: frame_position, frame: wrist, target: [1, 2 cm, 0], axes: [x, y], gain: 5}
costs:
  soft: {type: joint_limits, lower: -110 deg, upper: {j1: 90 deg}, stiffness: 5, delta: 2}
stack: {priority: [main, wrist]}
supervisor: {remove_above: 0.05, insert_below: 0.02, smoothing: 'off'}
phases:
  - name: hold
    contacts: {f1: fixed, f2: fixed}
    tasks: [wrist]
    until: {time: 1 s}
    timeout: {after: 2 s, then: stop}
  - name: lift
    contacts: {f1: fixed}
    reach: {f2: {clearance: 1 cm}}
    object: {target: {position: [0, 0.1], angle: 0}, relative: true}
    over: 1 s
simulation: {duration: 3 s, step: 2 ms}
"""

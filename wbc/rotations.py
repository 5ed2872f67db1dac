"""Rotations as 3x3 matrices: exponential, logarithm and cross product, compiled."""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array
from wbc.compiled import kernel


@kernel
def cross(a: Array, b: Array) -> Array:
    """a × b for two vectors of shape (3,)."""
    return np.array(
        (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    )


@kernel
def skew(a: Array) -> Array:
    """S(a), shape (3, 3), with S(a) b = a × b."""
    return np.array(((0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)))


# Products of 3x3 matrices, written out: compiled, they cost a tenth of a call into BLAS.


@kernel
def multiply(a: Array, b: Array, out: Array) -> None:
    """out = a b."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def multiply_transposed(a: Array, b: Array, out: Array) -> None:
    """out = a bᵀ."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@kernel
def rotate(a: Array, x: Array, out: Array) -> None:
    """out = a x."""
    for i in range(3):
        out[i] = a[i, 0] * x[0] + a[i, 1] * x[1] + a[i, 2] * x[2]


@kernel
def exp_so3(w: Array) -> Array:
    """Rotation by the rotation vector w [rad], shape (3, 3)."""
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    s = skew(w)
    if angle2 < 1e-12:  # the series is exact to rounding here, the quotients below are not
        small: Array = np.eye(3) + s + 0.5 * (s @ s)
        return small
    angle = np.sqrt(angle2)
    half = np.sin(0.5 * angle)
    r: Array = np.eye(3) + np.sin(angle) / angle * s + 2.0 * half * half / angle2 * (s @ s)
    return r


@kernel
def log_so3(r: Array) -> Array:
    """Rotation vector [rad], shape (3,), of the rotation r; its norm is at most pi.

    Goes through the unit quaternion, so that it stays accurate near 0 and near pi.
    """
    q = quaternion(r)
    sine = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    factor = 2.0 / q[3] if sine < 1e-9 else 2.0 * np.arctan2(sine, q[3]) / sine
    phi: Array = factor * q[:3]
    return phi


@kernel
def quaternion(r: Array) -> Array:
    """Unit quaternion (x, y, z, w) of the rotation r, with w >= 0."""
    candidates = np.array(
        (
            1.0 + r[0, 0] - r[1, 1] - r[2, 2],
            1.0 - r[0, 0] + r[1, 1] - r[2, 2],
            1.0 - r[0, 0] - r[1, 1] + r[2, 2],
            1.0 + r[0, 0] + r[1, 1] + r[2, 2],
        )
    )
    k = np.argmax(candidates)
    d = candidates[k]
    if k == 0:
        q = np.array((d, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]))
    elif k == 1:
        q = np.array((r[0, 1] + r[1, 0], d, r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]))
    elif k == 2:
        q = np.array((r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], d, r[1, 0] - r[0, 1]))
    else:
        q = np.array((r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], d))
    if q[3] < 0.0:
        q = -q
    unit: Array = q / np.sqrt(np.sum(q * q))
    return unit


@kernel
def dexp_inverse(phi: Array, w: Array) -> Array:
    """Rate of the rotation vector phi when exp(phi) turns at w (fixed axes), to O(phi^4).

    For the stages of a Runge-Kutta step, where |phi| is the rotation of one tick.
    """
    c = cross(phi, w)
    return w - 0.5 * c + cross(phi, c) / 12.0


@kernel
def log_jacobian(phi: Array) -> Array:
    """Λ(φ), shape (3, 3): φ̇ = Λ ω when exp(φ) turns at ω in the fixed axes; φ̇ = Λᵀ ω in its own.

    The inverse of the left Jacobian of SO(3), exact for |φ| < 2π and thus for every logarithm, also
    at π: Λ = I − S(φ)/2 + c S(φ)² with c = (1 − (|φ|/2) cot(|φ|/2)) / |φ|² (Solà, Deray, Atchuthan,
    "A micro Lie theory for state estimation in robotics", 2018, (146)).
    """
    angle2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    if angle2 < 1e-3:  # the quotient loses digits here, the series has them all
        c = 1.0 / 12.0 + angle2 / 720.0 + angle2 * angle2 / 30240.0
    else:
        half = 0.5 * np.sqrt(angle2)
        c = (1.0 - half / np.tan(half)) / angle2
    s = skew(phi)
    derivative: Array = np.eye(3) - 0.5 * s + c * (s @ s)
    return derivative


def rotation_from_rpy(rpy: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll) from (roll, pitch, yaw) [rad], the URDF's convention."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    x, y, z = np.eye(3)
    rotation: Array = exp_so3(yaw * z) @ exp_so3(pitch * y) @ exp_so3(roll * x)
    return rotation


def rotation_from_quaternion(q: Array) -> Array:
    """Rotation of the quaternion (x, y, z, w); normalised first, the caller refuses a zero one."""
    x, y, z, w = np.asarray(q, dtype=np.float64) / np.linalg.norm(q)
    s = skew(np.array((x, y, z)))
    rotation: Array = np.eye(3) + 2.0 * w * s + 2.0 * s @ s
    return rotation

"""The table of all surfaces: sizes to try, contacts on them, and their frames.

A class that is not here fails the suite.
"""

from __future__ import annotations

import numpy as np

from wbc.contact.surfaces import SURFACES, gauss_frames

BANANA = ((2.0, 0.0, 0.0, 0.25, 0.0),)
STAR = ((5.0, 0.06, 0.0, 0.0, 0.06), (3.0, 0.06, 0.0, 0.0, -0.06))
EXAMPLES = {
    "circle": [{"radius": 0.5}, {"radius": 0.03}],
    "ellipse": [{"a": 0.5, "b": 0.3}, {"a": 0.02, "b": 0.15}],
    "superellipse": [{"a": 0.5, "b": 0.3, "p": 4}, {"a": 0.05, "b": 0.08, "p": 2.5}],
    "fourier_contour": [
        {"a": 0.5, "b": 0.36, "h": 0.06},
        {"a": 0.5, "b": 0.15, "harmonics": BANANA},
        {"a": 0.4, "b": 0.4, "harmonics": STAR},
    ],
    "sphere": [{"radius": 0.05}],
    "spheroid": [{"a": 0.045, "b": 0.06}, {"a": 0.08, "b": 0.03}],
    "cylinder": [{"radius": 0.04, "length": 0.2}],
    "superellipsoid": [
        {"ax": 0.04, "ay": 0.05, "az": 0.07, "p": 4},
        {"ax": 0.07, "ay": 0.04, "az": 0.03, "p": 2.5},
        {"ax": 0.04, "ay": 0.05, "az": 0.06, "p": 8},
    ],
    "box": [{"size": [0.1, 0.2, 0.3]}],
}
CASES = [(name, k) for name, all_sizes in EXAMPLES.items() for k in range(len(all_sizes))]
POLAR = [case for case in CASES if case[0] in ("sphere", "spheroid", "superellipsoid")]
PLANAR = [case for case in CASES if SURFACES[case[0]].planar]
WINDING = [("fourier_contour", 1), ("fourier_contour", 2)]
CONVEX = [case for case in CASES if case[0] != "fourier_contour"]


def build(case):
    name, k = case
    return SURFACES[name](**EXAMPLES[name][k])


def contacts(surface, n=40, seed=0, inside=0.97):
    """Random regular chart coordinates over all faces; v of a contour stays 0."""
    rng = np.random.default_rng(seed)
    face = np.arange(n) % len(surface.faces)
    xi = np.empty((n, 2))
    for i in range(n):
        domain = surface.domain(int(face[i]))
        while True:
            high = np.minimum(domain.upper, 1e9)
            xi[i] = inside * rng.uniform(np.maximum(domain.lower, -1e9), high)
            if surface.regular(xi[i], int(face[i])):
                break
    if surface.planar:
        xi[:, 1] = 0.0
    return xi, face.astype(np.int64)


def frames(surface, xi, face):
    charts = surface.charts(xi, face)
    n = charts.shape[0]
    out = np.empty((n, 3, 3)), np.empty((n, 3, 2)), np.empty((n, 3, 2))
    gauss_frames(charts, *out)
    return charts, *out


def extent(surface):
    return float(np.max(np.abs(surface.mesh(24)[0])))


def difference(function, xi, j, step):
    """Fourth-order central difference of function(xi) along coordinate j."""
    h = np.zeros(2)
    h[j] = step
    near = function(xi + h) - function(xi - h)
    far = function(xi + 2 * h) - function(xi - 2 * h)
    return (8.0 * near - far) / (12.0 * step)


def chart_step(surface):
    """A small step of the chart coordinates: of an angle 2e-4, of a length a part of the body."""
    return 2e-4 if surface.domain(0).period[0] else 1e-3 * extent(surface)


def smooth_contacts(case):
    """Contacts away from where finite differences fail: the axes, if p is not whole.

    There the second derivatives have a corner.
    """
    surface = build(case)
    xi, face = contacts(surface, 80)
    if EXAMPLES[case[0]][case[1]].get("p") == 2.5:
        apart = np.abs(surface.charts(xi, face)[:, 0, : 2 if surface.planar else 3])
        kept = np.min(apart, axis=1) > 0.1 * extent(surface)
        assert np.sum(kept) >= 20
        xi, face = xi[kept], face[kept]
    return xi, face

"""Rims that look like rims. Apart from the other meshes: the viewer's process has no need of it."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from wbc.arrays import Array, IntArray
from wbc.view.meshes import Mesh


def creased(vertices: Array, triangles: IntArray, angle: float = 0.6) -> Mesh:
    """The same surface with its vertices split where faces meet at more than `angle` [rad].

    A page shades a mesh by the mean normal at each vertex: a rim has to have two vertices to look
    like one.
    """
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    # every edge a-b of a face, and the same edge b-a of its neighbour
    count = len(triangles)
    edges = np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    code = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(code)
    opposite = edges[:, 1] * len(vertices) + edges[:, 0]
    found = order[np.minimum(np.searchsorted(code, opposite, sorter=order), len(code) - 1)]
    one = np.flatnonzero(code[found] == opposite)
    two = found[one]
    smooth = np.sum(normal[one % count] * normal[two % count], axis=1) > np.cos(angle)
    one, two = one[smooth], two[smooth]
    # corner k of face f is number f + k · count, as edge k is; one's first vertex is two's second
    after = (two + count) % (3 * count)
    link = coo_matrix((np.ones(len(one)), (one, after)), shape=(3 * count, 3 * count))
    _, label = connected_components(link, directed=False)
    _, first, index = np.unique(label, return_index=True, return_inverse=True)
    split = triangles.T.ravel()[first]
    return vertices[split], np.asarray(index.ravel().reshape(3, count).T, dtype=np.int64)

"""Polygons in the plane: simple or not, triangles, convex pieces, outlines around them.

A polygon is an array (n, 2) of its corners [m] in counterclockwise order, not closed.
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray


def cross2(a: Array, b: Array) -> Array:
    """z of a x b for plane vectors (..., 2)."""
    out: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def signed_area(polygon: Array) -> float:
    """Positive when counterclockwise [m²]."""
    return 0.5 * float(np.sum(cross2(polygon, np.roll(polygon, -1, axis=0))))


def is_simple(polygon: Array) -> bool:
    """Whether no two sides that are not neighbours cross."""
    n = polygon.shape[0]
    a, b = polygon, np.roll(polygon, -1, axis=0)
    side = b - a

    def beside(points: Array) -> Array:
        """Row i, column j: on which side of line i point j is."""
        return cross2(side[:, None, :], points[None, :, :] - a[:, None, :])

    splits = beside(a) * beside(b) < 0.0
    crossing = splits & splits.T
    index = np.arange(n)
    apart = np.abs(index[:, None] - index[None, :])
    return not bool(np.any(crossing & (apart > 1) & (apart < n - 1)))


def triangles(polygon: Array) -> IntArray:
    """Cut a simple polygon into n - 2 counterclockwise triangles (n - 2, 3) by removing ears."""
    left = list(range(polygon.shape[0]))
    out: list[tuple[int, int, int]] = []
    while len(left) > 3:
        out.append(cut_ear(polygon, left))
    out.append((left[0], left[1], left[2]))
    return np.array(out, dtype=np.int64)


def cut_ear(polygon: Array, left: list[int]) -> tuple[int, int, int]:
    """Remove from `left` the corner of the widest ear and return the triangle it leaves.

    The widest, so that a smooth contour is not cut into slivers.
    """
    index = np.array(left)
    before, corner, after = (polygon[np.roll(index, k)] for k in (1, 0, -1))
    area = cross2(corner - before, after - corner)
    size = np.linalg.norm(corner - before, axis=1) * np.linalg.norm(after - corner, axis=1)
    for k in np.argsort(-area / np.maximum(size, 1e-300)):
        triangle = np.array([before[k], corner[k], after[k]])
        others = np.delete(polygon[index], [(k - 1) % len(left), k, (k + 1) % len(left)], axis=0)
        if not np.any(inside_convex(triangle, others)) or area[k] == 0.0:
            break
    m = len(left)
    ear = (left[(k - 1) % m], left[k], left[(k + 1) % m])
    del left[k]
    return ear


def inside_convex(polygon: Array, points: Array) -> BoolArray:
    """Which of the points (m, 2) are inside or on a convex polygon."""
    side = np.roll(polygon, -1, axis=0) - polygon
    beside = cross2(side[:, None, :], points[None, :, :] - polygon[:, None, :])
    out: BoolArray = np.all(beside >= 0.0, axis=0)
    return out


def convex_hull(polygon: Array) -> IntArray:
    """Indices of the corners of the convex hull, in the order of the (simple) polygon."""
    order = np.lexsort((polygon[:, 1], polygon[:, 0]))

    def chain(indices: IntArray) -> list[int]:
        kept: list[int] = []
        for i in indices:
            while len(kept) > 1:
                last, p = polygon[kept[-1]], polygon[kept[-2]]
                if cross2(last - p, polygon[i] - last) > 0.0:
                    break
                kept.pop()
            kept.append(int(i))
        return kept[:-1]

    return np.array(sorted(chain(order) + chain(order[::-1])), dtype=np.int64)


def deepest_notch(polygon: Array) -> tuple[int, float]:
    """The corner farthest inside the convex hull's boundary pockets, and its depth [m]."""
    hull = convex_hull(polygon)
    n, best, depth = polygon.shape[0], 0, 0.0
    for first, last in zip(hull, np.roll(hull, -1), strict=True):
        pocket = np.arange(first + 1, last if last > first else last + n) % n
        if pocket.size == 0:
            continue
        lid = polygon[last] - polygon[first]
        gap = cross2(lid, polygon[pocket] - polygon[first]) / np.linalg.norm(lid)
        k = int(np.argmax(gap))
        if gap[k] > depth:
            best, depth = int(pocket[k]), float(gap[k])
    return best, depth


def split_at(polygon: Array, corner: int) -> tuple[Array, Array]:
    """Cut a simple polygon straight across from one corner, along the bisector of its angle."""
    n = polygon.shape[0]
    turned = np.roll(polygon, -corner, axis=0)
    origin = turned[0]
    ahead = turned[1] - origin
    back = turned[-1] - origin
    tangent = ahead / np.linalg.norm(ahead) - back / np.linalg.norm(back)
    ray = np.array([-tangent[1], tangent[0]])
    ends = turned[1:] - origin
    beside = cross2(ray, ends)
    across = beside[:-1] * beside[1:] <= 0.0
    change = beside[:-1] - beside[1:]
    across &= change != 0.0
    weight = beside[:-1] / np.where(across, change, 1.0)
    hits = ends[:-1] + weight[:, None] * (ends[1:] - ends[:-1])
    reach = np.where(across & (hits @ ray > 0.0), hits @ ray, np.inf)
    k = int(np.argmin(reach))
    hit = origin + hits[k]
    # side k of the turned polygon goes from corner k + 1 to corner k + 2
    one = np.vstack([turned[: k + 2], hit])
    other = np.vstack([turned[:1], hit, turned[k + 2 : n]])
    return one, other


def convex_parts(polygon: Array, depth: float) -> list[Array]:
    """Cut a simple polygon at its notches until each part fills its hull to `depth` [m]."""
    todo: list[Array] = [polygon]
    done: list[Array] = []
    while todo:
        part = todo.pop()
        corner, notch = deepest_notch(part)
        if notch <= depth or len(done) + len(todo) > 200:
            done.append(part[convex_hull(part)])
        else:
            todo.extend(split_at(part, corner))
    return done


def wrap_convex(points: Array, excess: float) -> Array:
    """A convex polygon of few corners around the points (m, 2), at most `excess` [m] outside them.

    Its sides are supporting lines; between two of them another is added halfway while their common
    corner stands out too far.
    """
    angles = np.arange(8) * (np.pi / 4.0)
    for _ in range(8):
        normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        heights = points @ normals.T
        touch = points[np.argmax(heights, axis=0)]
        support = np.max(heights, axis=0)
        following, next_support = np.roll(normals, -1, axis=0), np.roll(support, -1)
        det = cross2(normals, following)
        corners = np.stack(
            [
                support * following[:, 1] - next_support * normals[:, 1],
                next_support * normals[:, 0] - support * following[:, 0],
            ],
            axis=1,
        )
        corners /= det[:, None]
        out = distance_to_sides(corners, touch, np.roll(touch, -1, axis=0)) > excess
        if not np.any(out):
            break
        gaps = (np.roll(angles, -1) - angles) % (2.0 * np.pi)
        angles = np.sort(np.concatenate([angles, angles[out] + 0.5 * gaps[out]]))
    # lines that pass through one sharp corner of the body meet there again and again
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > 1e-9
    separate: Array = corners[apart]
    return separate


def distance_to_sides(points: Array, start: Array, end: Array) -> Array:
    """Distance of each point (m, 2) from its own segment start-end (m, 2 each)."""
    side = end - start
    length = np.maximum(np.sum(side * side, axis=1), 1e-300)
    along = np.clip(np.sum((points - start) * side, axis=1) / length, 0.0, 1.0)
    out: Array = np.linalg.norm(points - start - along[:, None] * side, axis=1)
    return out

"""Flat meshes on the floor: lines of a real width, dashes, swept boxes, grids.

Lines proper are one pixel wide in every browser, whatever width is asked for.
"""

import dataclasses as dc
from collections.abc import Iterable, Sequence

import numpy as np

SHORTEST = 1e-4  # [m] Points of a line that are nearer than this are one.
SHARPEST = 0.25  # Cosine of half the turn of a line at a point, from which on corners are cut.


@dc.dataclass(frozen=True)
class FlatMesh:
    """Triangles in a horizontal plane, seen from above."""

    points: np.ndarray  # (V, 2) [m]
    triangles: np.ndarray  # (F, 3) indices of points, counter-clockwise.


def joined(meshes: Iterable[FlatMesh]) -> FlatMesh:
    """Returns meshes as one."""
    points, triangles, count = [np.zeros((0, 2))], [np.zeros((0, 3), dtype=int)], 0
    for mesh in meshes:
        points.append(mesh.points)
        triangles.append(mesh.triangles + count)
        count += len(mesh.points)
    return FlatMesh(np.concatenate(points), np.concatenate(triangles))


def ribbon(line: np.ndarray, width: float) -> FlatMesh:
    """Returns a line (n, 2) [m] as a band of a width [m]; empty where the line is a point."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    line = line[np.concatenate([[True], steps > SHORTEST])]
    if len(line) < 2:
        return joined([])
    along = np.diff(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    before, after = np.vstack([along[:1], along]), np.vstack([along, along[-1:]])
    middle = before + after
    middle /= np.maximum(np.linalg.norm(middle, axis=1), 1e-9)[:, None]
    stretch = np.maximum(np.sum(middle * after, axis=1), SHARPEST)
    left = 0.5 * width * np.column_stack([-middle[:, 1], middle[:, 0]]) / stretch[:, None]
    points = np.stack([line + left, line - left], axis=1).reshape(-1, 2)
    first = 2 * np.arange(len(line) - 1)[:, None]
    triangles = np.vstack([first + np.array([0, 1, 2]), first + np.array([1, 3, 2])])
    return FlatMesh(points, triangles)


def dashes(line: np.ndarray, dash: float, gap: float) -> list[np.ndarray]:
    """Returns the pieces (m, 2) of a line (n, 2) that dashes [m] with gaps [m] between leave."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    pieces = []
    for start in np.arange(0.0, travelled[-1], dash + gap):
        inside = travelled[(travelled > start) & (travelled < start + dash)]
        at = np.concatenate([[start], inside, [min(start + dash, travelled[-1])]])
        pieces.append(np.column_stack([np.interp(at, travelled, line[:, i]) for i in range(2)]))
    return pieces


def swept_box(
    start: np.ndarray, start_half: np.ndarray, end: np.ndarray, end_half: np.ndarray
) -> FlatMesh:
    """Returns the hull of two boxes along the axes: what one sweeps as it becomes the other.

    Args:
        start: (2,) [m] middle of the first box.
        start_half: (2,) [m] its half-widths.
        end: (2,) [m] middle of the second.
        end_half: (2,) [m] its half-widths.
    """
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    return convex_hull(np.vstack([start + corners * start_half, end + corners * end_half]))


def convex_hull(points: np.ndarray) -> FlatMesh:
    """Returns the convex hull of points (n, 2), as a fan; empty where they lie on a line."""
    ordered = sorted({tuple(point) for point in points.tolist()})
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    hull = np.array(lower[:-1] + upper[:-1]).reshape(-1, 2)
    fan = [[0, i, i + 1] for i in range(1, len(hull) - 1)]
    return FlatMesh(hull, np.array(fan, dtype=int).reshape(-1, 3))


def _chain(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Returns half of a hull, by Andrew's monotone chain."""
    chain: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(chain) > 1:
            (x0, y0), (x1, y1) = chain[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                break
            chain.pop()
        chain.append((x, y))
    return chain


def rectangle(lower: np.ndarray, upper: np.ndarray) -> FlatMesh:
    """Returns a rectangle along the axes between two corners (2,) [m]."""
    (x0, y0), (x1, y1) = lower, upper
    points = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return FlatMesh(points, np.array([[0, 1, 2], [0, 2, 3]]))


def grid(lower: np.ndarray, upper: np.ndarray, spacing: float, width: float) -> FlatMesh:
    """Returns lines at multiples of a spacing [m] strictly within a rectangle."""
    lines = []
    for axis in range(2):
        first, last = np.ceil(lower[axis] / spacing + 1e-6), np.floor(upper[axis] / spacing - 1e-6)
        for i in range(int(first), int(last) + 1):
            low, high = lower.copy(), upper.copy()
            low[axis], high[axis] = i * spacing - width / 2, i * spacing + width / 2
            lines.append(rectangle(low, high))
    return joined(lines)

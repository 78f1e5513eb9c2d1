"""Meshes of boxes and of rings that share no node."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import meshio
import numpy as np

AXES = "xyz"


def blocks(path: Path, *parts: tuple[Any, Any, Any], tetrahedra: bool = False) -> Path:
    """Write a mesh of boxes without common nodes, each of (low, high, numbers of cells).

    The groups are the sides of each box: "0 low x", "1 high y" and so on.
    """
    points, cells, sides = np.zeros((0, 3)), [], {}
    for number, (low, high, counts) in enumerate(parts):
        d, first = len(low), len(points)
        lines = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
        x = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, d)
        at = first + np.arange(len(x)).reshape([n + 1 for n in counts])
        corner = {
            key: at[tuple(slice(k, n + k) for k, n in zip(key, counts, strict=True))].ravel()
            for key in itertools.product((0, 1), repeat=d)
        }
        ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
        order = ring if d == 2 else [(*xy, z) for z in (0, 1) for xy in ring]
        box = np.stack([corner[key] for key in order], axis=1)
        paths = [(1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1)]  # around the diagonal 0-6
        cells += [box[:, (0, a, b, 6)] for a, b in paths] if tetrahedra else [box]
        points = np.concatenate([points, np.pad(x, ((0, 0), (0, 3 - d)))])
        for axis in range(d):
            for name, end in (("low", low), ("high", high)):
                nodes = first + np.flatnonzero(x[:, axis] == end[axis])
                sides[f"{number} {name} {AXES[axis]}"] = nodes
    marks = {name: np.isin(np.arange(len(points)), on).astype(int) for name, on in sides.items()}
    kind = "tetra" if tetrahedra else "quad" if d == 2 else "hexahedron"
    meshio.Mesh(points, [(kind, np.concatenate(cells))], point_data=marks).write(path)
    return path


def stacked(path: Path, d: int, upper: int, lower: int, **options: Any) -> Path:
    """Two blocks of 0.1 x 0.05 (x 0.06) m on one another with these cells along x."""
    size, widths = (0.1, 0.05, 0.06)[:d], ((), (upper - 1,), (lower - 1,))
    top = (0.0, 0.05, 0.0)[:d], (0.1, 0.1, 0.06)[:d], (upper, 3, *widths[1])[:d]
    return blocks(path, ((0.0,) * d, size, (lower, 3, *widths[2])[:d]), top, **options)


def rings(path: Path, *parts: tuple[float, float, int, int], angle: float = 2.0 * np.pi) -> Path:
    """Write a plane mesh of rings about the origin, each of two radii and cells along and around.

    The groups are the inner and outer edge of each ring, "0 low" and "0 high", and the ends "left"
    and "right" of an angle below 2π.
    """
    points, cells, sets = np.zeros((0, 3)), [], {"left": [], "right": []}
    whole = angle >= 2.0 * np.pi
    for number, (low, high, along, around) in enumerate(parts):
        first, phi = len(points), np.linspace(0.0, angle, around + 1)[: around + 1 - whole]
        radius = np.linspace(low, high, along + 1)
        at = first + np.arange(len(phi) * len(radius)).reshape(len(phi), -1)
        x = [(r * np.cos(a), r * np.sin(a), 0.0) for a in phi for r in radius]
        points, after = np.concatenate([points, x]), np.roll(at, -1, axis=0)
        one, two = at[:around], after[:around]
        quads = np.stack([one[:, :-1], one[:, 1:], two[:, 1:], two[:, :-1]], axis=2)
        cells.append(quads.reshape(-1, 4))
        sets |= {f"{number} low": at[:, 0], f"{number} high": at[:, -1]}
        sets["right"], sets["left"] = [*sets["right"], *at[0]], [*sets["left"], *at[-1]]
    if whole:
        del sets["left"], sets["right"]
    marks = {name: np.isin(np.arange(len(points)), on).astype(int) for name, on in sets.items()}
    meshio.Mesh(points, [("quad", np.concatenate(cells))], point_data=marks).write(path)
    return path

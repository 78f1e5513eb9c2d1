"""Names of the modes of a rotating body, such as 1F (first flap) and 1T (first torsion).

The rule looks at the tip: the nodes within the outermost part `TIP` of the span, which is measured
along the radius r from the axis of rotation to the middle of the body. The chord c and the normal n
of the tip section are the principal axes of these nodes perpendicular to r, with the larger spread
along c. If the spreads are nearly equal, n is along the axis of rotation. A rigid motion is fitted
to the tip; t is its translation, theta its rotation, and rho the distance from r. The largest of
these lengths gives the letter:

    F  flap       |t . n|                E  edge   |t . c|
    T  torsion    |theta . r| rms(rho)   A  axial  |t . r|
    C  chordwise bending of the section: rms of the displacement that the rigid motion leaves

The number counts the modes of one letter in the order of their frequencies.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array

TIP = 0.05
"""Part of the span that is the tip."""

ROUND = 1.5
"""Ratio of the principal spreads below which a section has no chord of its own."""

LEAST_RADIUS = 0.1
"""Smallest distance of the middle of the body from the axis, relative to the size of the body."""

LETTERS = ("F", "E", "T", "A", "C")


def mode_names(
    positions: Array, shapes: NDArray[Any], axis: Array, point: Array, comm: Any
) -> list[str]:
    """Name modes by their motion at the tip. Collective.

    Args:
        positions: (n, d) nodes of this rank, m.
        shapes: (n, d, m) shapes at these nodes, real or complex, in ascending frequency.
        axis: (3,) unit vector of the axis of rotation.
        point: (3,) a point on it, m.
        comm: the communicator.

    Returns:
        One name per mode; empty for a body that does not point away from its axis, such as a shaft.
    """
    at, moved = _in_space(positions), _in_space(shapes)
    count = sum(comm.allgather(len(at)))
    middle = sum(comm.allgather(at.sum(axis=0))) / count - point
    radius = middle - (middle @ axis) * axis
    boxes = comm.allgather((at.min(axis=0), at.max(axis=0)) if len(at) else None)
    low = np.min([box[0] for box in boxes if box], axis=0)
    high = np.max([box[1] for box in boxes if box], axis=0)
    if np.linalg.norm(radius) < LEAST_RADIUS * np.linalg.norm(high - low):
        return []
    radial = radius / np.linalg.norm(radius)
    along = at @ radial
    top = max(comm.allgather(float(along.max(initial=-np.inf))))
    bottom = min(comm.allgather(float(along.min(initial=np.inf))))
    tip = along >= top - TIP * (top - bottom)
    at, moved = (
        np.concatenate(comm.allgather(part)) for part in (at[tip], np.ascontiguousarray(moved[tip]))
    )
    sizes = [tip_motion(at, moved[:, :, k], radial, axis) for k in range(moved.shape[2])]
    letters = [LETTERS[int(np.argmax(size))] for size in sizes]
    return [f"{letters[: k + 1].count(letter)}{letter}" for k, letter in enumerate(letters)]


def tip_motion(positions: Array, shape: NDArray[Any], radial: Array, axis: Array) -> Array:
    """The lengths that belong to `LETTERS`.

    Args:
        positions: (n, 3) nodes of the tip, m.
        shape: (n, 3) displacements of the tip, real or complex.
        radial: (3,) unit vector along the span.
        axis: (3,) unit vector of the axis of rotation.
    """
    arms = positions - positions.mean(axis=0)
    chord, normal = section_axes(arms, radial, axis)
    columns = np.zeros((arms.shape[0], 3, 6))
    columns[:, :, :3] = np.eye(3)
    columns[:, :, 3:] = np.cross(np.eye(3)[None], arms[:, None, :]).transpose(0, 2, 1)
    matrix = columns.reshape(-1, 6)
    rigid = np.linalg.lstsq(matrix, shape.reshape(-1), rcond=None)[0]
    rest = shape.reshape(-1) - matrix @ rigid
    across = arms - np.outer(arms @ radial, radial)
    rho = np.sqrt(np.mean(np.sum(across**2, axis=1)))
    lengths = [
        rigid[:3] @ normal,
        rigid[:3] @ chord,
        (rigid[3:] @ radial) * rho,
        rigid[:3] @ radial,
        np.linalg.norm(rest) / np.sqrt(len(arms)),
    ]
    return np.abs(lengths)


def section_axes(arms: Array, radial: Array, axis: Array) -> tuple[Array, Array]:
    """Chord and normal (3,) of a section of nodes at arms (n, 3) from its middle."""
    normal: Array = axis - (axis @ radial) * radial
    normal /= np.linalg.norm(normal)
    chord: Array = np.asarray(np.cross(normal, radial), dtype=np.float64)
    plane = np.array([chord, normal])
    spread, turn = np.linalg.eigh((arms @ plane.T).T @ (arms @ plane.T))
    if spread[1] > ROUND**2 * spread[0]:
        normal, chord = turn.T @ plane
    return chord, normal


def _in_space(block: NDArray[Any]) -> NDArray[Any]:
    """A block (n, d, ..) with three components."""
    missing = 3 - block.shape[1]
    return np.pad(block, [(0, 0), (0, missing)] + [(0, 0)] * (block.ndim - 2))

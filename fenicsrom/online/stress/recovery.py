"""What a reduced model needs to give stresses and reactions, and how an archive holds it.

With n coordinates, P Gauss points, C cells of g points and v vertices each, N vertices, S supports
with R Gauss points and m test functions, an archive with stresses holds these arrays of float64
besides those of `fenicsrom.online.store.archive`, in SI units:

    =========================== =================== ======= =====================================
    name                        shape               unit    meaning
    =========================== =================== ======= =====================================
    stress_position             (P, d)              m       Gauss points in the undeformed body
    stress_volume               (P,)                m^3     volume that a Gauss point stands for
    stress_gradients            (1 + n, P, d, d)    1, 1/m  gradients of u0, then of every vector
    stress_cells                (C, v) int64        -       vertices of each cell
    stress_vertex_position      (N, d)              m       vertices in the undeformed body
    stress_vertex_displacement  (1 + n, N, d)       m, 1    u0, then every vector, at the vertices
    stress_extrapolation        (v, g)              1       from Gauss points to vertices
    reaction_centre             (S, d)              m       centroid of the nodes of each support
    reaction_support            (R,) int64          -       support of each Gauss point
    reaction_gradients          (1 + n, R, d, d)    1, 1/m  as stress_gradients
    reaction_tests              (m, R, d, d)        m^2     test functions times volume
    reaction_mass               (S + 1, m, n)       kg      their products with the masses
    reaction_velocity           (S + 1, m, n)       kg/s    with Coriolis and viscous forces
    reaction_static             (S + 1, m, 1 + n)   N, N/m  with springs and centrifugal force
    reaction_loads              (S + 1, m, loads)   1       and with the unit loads
    =========================== =================== ======= =====================================

A scene with [[materials]] adds the numbers of the materials of the Gauss points, stress_material
(P,) and reaction_material (R,), int64; 0 is [material].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fenicsrom.online.stress.reactions import ReactionTable
from fenicsrom.online.stress.stress import StressLaw, StressTable
from fenicsrom.scene import Scene

OTHER = ("law", "material")
STRESS_ARRAYS = tuple(field.name for field in fields(StressTable) if field.name not in OTHER)
REACTION_ARRAYS = tuple(field.name for field in fields(ReactionTable) if field.name not in OTHER)
INTEGERS = ("stress_cells", "reaction_support", "stress_material", "reaction_material")


@dataclass(frozen=True, eq=False)
class Recovery:
    """The tables of the stresses and of the reactions of a reduced model."""

    stress: StressTable
    reactions: ReactionTable

    def of(self, chosen: Sequence[int]) -> Recovery:
        """The tables of some of the coordinates."""
        at = np.asarray(chosen, dtype=np.int64)
        if np.array_equal(at, np.arange(len(self.stress.gradients) - 1)):
            return self
        rows, stress, reactions = np.append(0, 1 + at), self.stress, self.reactions
        return Recovery(
            replace(
                stress,
                gradients=stress.gradients[rows],
                vertex_displacement=stress.vertex_displacement[rows],
            ),
            replace(
                reactions,
                gradients=reactions.gradients[rows],
                mass=reactions.mass[:, :, at],
                velocity=reactions.velocity[:, :, at],
                static=reactions.static[:, :, rows],
            ),
        )


def recovery_arrays(recovery: Recovery | None) -> dict[str, Any]:
    """The arrays of an archive by name; none if the model has no stresses."""
    if recovery is None:
        return {}
    stress = {f"stress_{name}": getattr(recovery.stress, name) for name in STRESS_ARRAYS}
    numbers = {
        "stress_material": recovery.stress.material,
        "reaction_material": recovery.reactions.material,
    }
    return (
        stress
        | {f"reaction_{name}": getattr(recovery.reactions, name) for name in REACTION_ARRAYS}
        | {name: values for name, values in numbers.items() if values is not None}
    )


def read_recovery(data: Mapping[str, Any], scene: Scene, n: int) -> Recovery | None:
    """Read the tables from the arrays of an archive; None if it has no stresses.

    Args:
        data: the arrays of the archive by name.
        scene: its scene.
        n: number of coordinates.

    Raises:
        ValueError: an array is missing or does not fit; the message names it.
    """
    if "stress_gradients" not in data:
        return None
    stress = {name: _array(data, f"stress_{name}") for name in STRESS_ARRAYS}
    found = {name: _array(data, f"reaction_{name}") for name in REACTION_ARRAYS}
    if scene.materials:
        stress["material"] = _array(data, "stress_material")
        found["material"] = _array(data, "reaction_material")
    shapes = _shapes(data, scene, n)
    for name, shape in shapes.items():
        if data[name].shape != shape:
            raise ValueError(f"{name} has shape {data[name].shape}: must be {shape}")
    for name, below in (
        ("stress_cells", stress["vertex_position"].shape[0]),
        ("reaction_support", len(scene.supports)),
        ("stress_material", 1 + len(scene.materials)),
        ("reaction_material", 1 + len(scene.materials)),
    ):
        if name not in shapes:
            continue
        if data[name].min(initial=0) < 0 or data[name].max(initial=0) >= below:
            raise ValueError(f"{name} has entries out of range")
    return Recovery(StressTable(StressLaw.of(scene), **stress), ReactionTable(**found))


def _array(data: Mapping[str, Any], name: str) -> Any:
    """An array of the archive, of its type and with finite numbers."""
    wanted = np.int64 if name in INTEGERS else np.float64
    if name not in data:
        raise ValueError(f"{name} is missing")
    if data[name].dtype != wanted or not np.all(np.isfinite(data[name])):
        raise ValueError(f"{name} is not an array of finite {np.dtype(wanted)}")
    return data[name]


def _shapes(data: Mapping[str, Any], scene: Scene, n: int) -> dict[str, tuple[int, ...]]:
    """The shape that each array must have, by name (module docstring)."""
    d, supports, loads = scene.geometry.dimension, len(scene.supports), len(scene.loads)
    m, r = 3 * (d - 1), data["reaction_support"].size
    v, g = (*data["stress_extrapolation"].shape, 0, 0)[:2]
    count, vertices = data["stress_cells"].shape[0], data["stress_vertex_position"].shape[0]
    numbers: dict[str, tuple[int, ...]] = {
        "stress_material": (count * g,),
        "reaction_material": (r,),
    }
    return (numbers if scene.materials else {}) | {
        "stress_extrapolation": (v, g),
        "stress_cells": (count, v),
        "stress_position": (count * g, d),
        "stress_volume": (count * g,),
        "stress_gradients": (1 + n, count * g, d, d),
        "stress_vertex_position": (vertices, d),
        "stress_vertex_displacement": (1 + n, vertices, d),
        "reaction_centre": (supports, d),
        "reaction_support": (r,),
        "reaction_gradients": (1 + n, r, d, d),
        "reaction_tests": (m, r, d, d),
        "reaction_mass": (supports + 1, m, n),
        "reaction_velocity": (supports + 1, m, n),
        "reaction_static": (supports + 1, m, 1 + n),
        "reaction_loads": (supports + 1, m, loads),
    }

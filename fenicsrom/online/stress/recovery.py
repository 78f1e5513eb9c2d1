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
    tables: dict[str, Any] = {"stress_": recovery.stress, "reaction_": recovery.reactions}
    return {
        kind + entry.name: value
        for kind, table in tables.items()
        for entry in fields(table)
        if entry.name != "law" and (value := getattr(table, entry.name)) is not None
    }


def read_recovery(data: Mapping[str, Any], scene: Scene) -> Recovery | None:
    """The tables from the arrays of an archive of a scene; None if it has no stresses."""
    if "stress_gradients" not in data:
        return None
    stress, reactions = (
        {name.removeprefix(kind): array for name, array in data.items() if name.startswith(kind)}
        for kind in ("stress_", "reaction_")
    )
    return Recovery(StressTable(StressLaw.of(scene), **stress), ReactionTable(**reactions))

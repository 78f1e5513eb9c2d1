"""Ties: two regions that move as one, although their meshes do not match.

A tie holds the mean distance around each corner i of the facets of region A at zero,

    x_i = 1/a_i ∫_A ψ_i (u_A(X) − u_B(X)) dA,    a_i = ∫_A ψ_i dA,                       (1)

with the linear hats ψ_i of A, as mortar elements do (Puso and Laursen, Comput. Methods Appl. Mech.
Eng. 193, 2004). A stiff spring does so,

    K += Σ κ a_i x_iᵀ x_i,    κ = STIFFNESS C/h,                                          (2)

with the largest entry C of the elasticity tensors of both sides and the size h of a facet of A. It
gives way as much as a layer of the body of the thickness h/STIFFNESS. X need not lie on B: u_B(X)
is the displacement of the cell of B there, continued beyond its facet. So (1) is exactly zero where
both bodies turn together, through gaps and chords of curved faces too.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array

from fenicsrom.fem.body.pairs import (
    Opposite,
    Side,
    averages,
    lagrange,
    opposite,
    sides_of,
    sparse_rows,
    tell,
)
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.scene import Region, Tie

STIFFNESS = 1e3
"""κ h/C: stiffer ties lose digits, which the bending of slender bodies needs."""

NEAR = 0.1
"""Largest distance of tied facets, relative to a facet, if the scene gives no reach."""


def tie(body: Any, one: Tie, number: int) -> tuple[csr_array, Ints]:
    """The stiffness (2) of a tie, sparse (local, local), N/m, and the nodes i.

    Args:
        body: the body, on one rank; its `pairs` take a sentence on what lies opposite.
        one: the tie.
        number: its number in the scene.

    Raises:
        SceneError: as `fenicsrom.fem.body.pairs.pair_rows`, but A may lie inside B.
    """
    place, names = f"ties[{number}]", ("group", "against")
    regions = {f"{place}.{name}": Region(group=getattr(one, name)) for name in names}
    key = f"{place}.against"
    a, b, _ = sides = sides_of(body, regions, key)
    size = float(a.size.mean())
    found = opposite(body, replace(one, reach=one.reach or NEAR * size), key, sides, whole=True)
    around = averages(body, one, key, found._replace(second=_continued(body, b, found)))
    tell(body, one, place, around, around.mean @ found.gap, (a, b))
    used = np.unique(body.materials.number[np.concatenate([a.cells, b.cells])])
    modulus = max(float(np.abs(body.materials.tensor(k)).max()) for k in used)
    springs = STIFFNESS * modulus / size * around.area.repeat(body.dimension)
    return csr_array(around.moved.T @ diags_array(springs) @ around.moved), around.nodes


def _continued(body: Any, side: Side, found: Opposite) -> csr_array:
    """Sparse rows (q, nodes) of the displacement u_B at the points X that B lies opposite."""
    domain, space = body.mesh.domain, body.space
    element = lagrange(domain.basix_cell(), body.geometry.degree)
    d, geometry = body.dimension, domain.geometry
    cells, values = side.cells[found.on], np.zeros((len(found.on), element.dim))
    seen = found.seen > 0.0
    for cell in np.unique(cells[seen]):
        mine = np.flatnonzero(seen & (cells == cell))
        corners = geometry.x[geometry.dofmap[cell], :d]
        points = geometry.cmap.pull_back(found.place[mine], corners)
        values[mine] = element.tabulate(0, points)[0, :, :, 0]
    return sparse_rows(space.dofmap.list[cells], values, len(space.tabulate_dof_coordinates()))

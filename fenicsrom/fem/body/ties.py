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

from fenicsrom.arrays import Array
from fenicsrom.fem.body.pairs import (
    Opposite,
    Side,
    averages,
    lagrange,
    modulus_of,
    opposite,
    sides_of,
    sparse_rows,
    tell,
)
from fenicsrom.scene import Region, Tie

STIFFNESS = 1e3
"""κ h/C: stiffer ties lose digits, which the bending of slender bodies needs."""

NEAR = 0.1
"""Largest distance of tied facets, relative to a facet, if the scene gives no reach."""


def tie(body: Any, one: Tie, number: int) -> tuple[csr_array, Array]:
    """The stiffness (2) of a tie, (local, size), N/m, and the places (P, d) of the i. Collective.

    Args:
        body: the body; its `pairs` take a sentence on what lies opposite.
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
    found = found._replace(second=_continued(body, b, found))
    around = averages(body, one, key, a, found, np.eye(body.dimension))
    tell(body, one, place, around, around.mean @ found.gap, (a, b))
    springs = STIFFNESS * modulus_of(body, sides) / size * around.area.repeat(body.dimension)
    return body.product(around.moved, diags_array(springs)), around.places


def _continued(body: Any, side: Side, found: Opposite) -> csr_array:
    """Sparse rows (q, nodes) of the displacement u_B at the points X that B lies opposite."""
    domain = body.mesh.domain
    element = lagrange(domain.basix_cell(), body.geometry.degree)
    cells, values = side.cells[found.on], np.zeros((len(found.on), element.dim))
    seen = found.seen > 0.0
    for cell in np.unique(cells[seen]):
        mine = np.flatnonzero(seen & (cells == cell))
        corners = side.cell_x[found.on[mine[0]]]
        points = domain.geometry.cmap.pull_back(found.place[mine], corners)
        values[mine] = element.tabulate(0, points)[0, :, :, 0]
    return sparse_rows(side.cell_nodes[found.on], values, body.size // body.dimension)

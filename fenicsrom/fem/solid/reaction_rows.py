"""The terms of the reactions of a solid: `fenicsrom.online.stress.reactions.ReactionTable`."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from fenicsrom.arrays import Array
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.body.supports import SAME_DIRECTION, rigid_motions, support_directions
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.online.stress.reactions import ReactionTable
from fenicsrom.scene import Scene

Nodes = npt.NDArray[np.int32]
Parts = tuple[Nodes, Array]


def reaction_table(solid: Solid, scene: Scene, vectors: Array) -> ReactionTable:
    """Tabulate the terms of the reactions of all supports. Collective.

    Args:
        solid: the body in its equilibrium.
        scene: its scene.
        vectors: (local, n) the basis vectors.

    Returns:
        The table, the same on every rank.
    """
    parts = _support_parts(solid, scene)
    centres = np.array([_centroid(solid, nodes) for nodes, _ in parts])
    tests = [_test_functions(solid, mine, x) for mine, x in zip(parts, centres, strict=True)]
    whole = np.zeros_like(tests[0])
    whole[:, : solid.dimension] = solid.translations()
    cells = [
        _gradients_at(solid, nodes, test, vectors)
        for (nodes, _), test in zip(parts, tests, strict=True)
    ]
    rows = [_rows(solid, test, vectors) for test in (*tests, whole)]
    sizes = [part[0].shape[1] for part in cells]
    return ReactionTable(
        centres,
        np.repeat(np.arange(len(parts)), sizes),
        np.concatenate([part[0] for part in cells], axis=1),
        np.concatenate([part[1] for part in cells], axis=1),
        *(np.array(term) for term in zip(*rows, strict=True)),
        np.concatenate([part[2] for part in cells]) if scene.materials else None,
    )


def _support_parts(solid: Solid, scene: Scene) -> list[Parts]:
    """The nodes (k,) of each support, ghosts included, and the parts (k, d, d) it takes there.

    At a node with the directions n_1, .. of all supports, a force R of this span is Σ (m_i · R) n_i
    with the dual directions m_i. The part of a support in W · R, with the displacement W of the
    node, is that of its directions: it has the test function Σ m_i n_iᵀ W. A direction that depends
    on those of earlier supports takes nothing.
    """
    found = [support_directions(solid.mesh, solid.space, s, solid.source) for s in scene.supports]
    parts: list[Parts] = []
    meeting = np.bincount(np.concatenate([nodes for nodes, _ in found]))
    for k, (nodes, directions) in enumerate(found):
        matrices = np.tile(directions.T @ directions, (nodes.size, 1, 1))
        for row in np.flatnonzero(meeting[nodes] > 1):
            matrices[row] = _part_at(int(nodes[row]), k, found)
        kept = matrices.any(axis=(1, 2))
        parts.append((nodes[kept], matrices[kept]))
    return parts


def _part_at(node: int, support: int, found: Sequence[tuple[Nodes, Array]]) -> Array:
    """The part (d, d) that a support takes at a node where supports meet."""
    d = found[0][1].shape[1]
    kept, owners = np.zeros((0, d)), []
    for k, (nodes, directions) in enumerate(found):
        for direction in directions if node in nodes else ():
            longer = np.vstack([kept, direction])
            if np.linalg.svd(longer, compute_uv=False)[-1] ** 2 > SAME_DIRECTION and len(kept) < d:
                kept, owners = longer, [*owners, k]
    mine = np.array(owners) == support
    return np.asarray(np.linalg.pinv(kept)[:, mine] @ kept[mine])


def _centroid(solid: Solid, nodes: Nodes) -> Array:
    """Mean place (d,) of nodes over all ranks, m."""
    owned = nodes[nodes < solid.local // solid.dimension]
    x = solid.space.tabulate_dof_coordinates()[owned, : solid.dimension]
    count = solid.comm.allreduce(owned.size)
    return np.asarray(solid.comm.allreduce(x.sum(axis=0)) / max(count, 1))


def _test_functions(solid: Solid, parts: Parts, centre: Array) -> Array:
    """Translations and rotations (local, m) about a centre, of the part of a support only."""
    d = solid.dimension
    own = parts[0] < solid.local // d
    nodes, matrices = parts[0][own], parts[1][own]
    arm = solid.space.tabulate_dof_coordinates()[nodes] - np.pad(centre, (0, 3 - d))
    fields = np.zeros((solid.local // d, d, 3 * (d - 1)))
    fields[nodes] = matrices @ rigid_motions(arm, d)
    return fields.reshape(solid.local, -1)


def _gradients_at(
    solid: Solid, nodes: Nodes, tests: Array, vectors: Array
) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Displacement gradients, and weighted gradients of the tests, in the cells at some nodes.

    The numbers of the materials of the points follow.

    The points are those of the quadrature rule of the internal force, on all ranks.
    """
    touching = np.isin(solid.space.dofmap.list, nodes).any(axis=1)
    owned = solid.owned_cells()
    cells = owned[touching[owned]]
    m = tests.shape[1]
    fields = np.concatenate([vectors, tests], axis=1)
    weights, values = solid.tabulated(fields, solid.equilibrium, cells=cells)
    values[-m:] *= weights[:, None, None]
    every = np.concatenate(solid.comm.allgather(values), axis=1)
    numbers = solid.materials.of_points(weights.size // max(1, cells.size), cells)
    return every[:-m], every[-m:], np.concatenate(solid.comm.allgather(numbers))


def _rows(solid: Solid, tests: Array, vectors: Array) -> tuple[Array, Array, Array, Array]:
    """The products of test functions with the linear terms of the equation of motion.

    The matrices of the solid have no clamped rows, so the forms are assembled anew.

    Returns:
        Mass (m, n), velocity (m, n), static (m, 1 + n) and loads (m, loads), as in `ReactionTable`.
    """
    density = solid.density
    test, w = ufl.TestFunction(solid.space), fem.Function(solid.space)
    fields = np.concatenate([solid.equilibrium[:, None], vectors], axis=1)

    def products(integrand: ufl.core.expr.Expr, columns: Array) -> Array:
        """∫ ρ (integrand with W) of columns (local, k), (m, k)."""
        form = compiled_form(density * integrand * solid.dx)
        found = np.empty_like(tests)
        for k in range(tests.shape[1]):
            w.x.array[: solid.local] = tests[:, k]
            w.x.scatter_forward()
            found[:, k] = solid.assembled(form)
        return solid.inner(found, columns)

    def mass_products(columns: Array) -> Array:
        attached = solid.inner(tests, solid.point_masses[:, None] * columns)
        return attached + products(ufl.dot(w, test), columns)

    velocity = np.zeros((tests.shape[1], vectors.shape[1]))
    centrifugal = np.zeros((tests.shape[1], fields.shape[1]))
    springs = solid.inner(tests, solid.coupled(solid.couplings, fields))
    frame = solid.rotation
    if frame is not None:
        form = compiled_form(density * frame.out_of_axis(frame.arm, test) * solid.dx)
        arm = solid.assembled(form) + frame.point_force
        centrifugal = products(frame.out_of_axis(w, test), fields)
        centrifugal += solid.inner(tests, frame.point_mass_times(fields))
        centrifugal[:, 0] += solid.inner(tests, arm[:, None])[:, 0]
        centrifugal *= frame.omega_squared
        if solid.gyroscopic is not None:
            turned = solid.inner(tests, frame.point_coriolis_times(vectors))
            velocity += frame.omega * (products(frame.coriolis(test, w), vectors) + turned)
    static = springs - centrifugal
    static[:, 0] -= solid.inner(tests, (solid.tension - solid.wall_force)[:, None])[:, 0]
    if (viscous := solid.viscous).acts:
        velocity += mass_products(viscous.modes) @ solid.inner(viscous.modal, vectors)
        velocity += solid.inner(tests, solid.coupled(solid.dashpots, vectors))
        if viscous.stiffness > 0.0:
            strains = solid.inner(solid.unclamped_strain_stiffness_times(tests), vectors)
            held = solid.inner(tests, solid.coupled(solid.spring_couplings, vectors))
            velocity += viscous.stiffness * (strains + held)
    loads = [solid.load_vector(load, f"loads[{k}]") for k, load in enumerate(solid.loads)]
    unit = np.array(loads).reshape(len(loads), solid.local).T
    return mass_products(vectors), velocity, static, solid.inner(tests, unit)

"""Candidates: the vectors that a basis leaves out and that an error estimate may add to it.

A reduced model is stored together with a larger model of N = n + w coordinates,

    u = u₀ + [R, W] (q, e),    Bᵀ W = 0,    Wᵀ M R_s = 0,    Wᵀ M W = I,    (1)

whose first n coordinates are those of the basis R. The candidates W are the next normal and
interface modes, the static deflections under the loads (attachment modes) and, of bodies
that touch, under what moves the equilibrium (`fenicsrom.online.step.statics.together`), those
under the inertia forces of the deflections under loads and contact forces, and combinations of the
modal derivatives that the basis lacks. These derivatives include those of the next modes. At every
motion of the reduced model, the projected force of the larger model contains the residual Wᵀ r of
the full equations as a polynomial. No mesh is therefore needed to judge a stored model
(`fenicsrom.assess.errors.estimates.basis_errors`). What no candidate holds,
`fenicsrom.assess.errors.judge` finds where there is a mesh.

The response to a load or a contact force p in powers of ω² is

    K⁻¹ p + ω² K⁻¹ M K⁻¹ p + ω⁴ (K⁻¹ M)² K⁻¹ p + ...                                            (2)

These vectors (load-dependent Ritz vectors: Wilson, Yuan and Dickens 1982) combine the modes by
their share in the load and in the contact, the lowest first. They move in directions in which none
of the next modes moves, such as the axis of a slender body that is pushed along it or hits a stop.
They are computed from the part of K⁻¹ p that is orthogonal to the modes, because the lowest modes
would hide the others.

The derivatives θ_ij are combined by their elastic energy at equal energy of the modes: θ_ij has the
weight a_i a_j with a_i² Xᵢᵀ K Xᵢ = 1 (`fenicsrom.reduction.derivatives.combinations`). Where
derivatives are taken along principal directions, the next combinations are candidates too.

A load whose static response K⁻¹ p joins the basis, such as an axial one, changes the stiffness of
the modes. The derivatives of the modes along this response are therefore candidates, although a
motion that is stable within the basis holds no product of both.

The reduced model of finer elements (`finer_model`) judges the mesh.
It has the same modes and derivatives as the model of the run, each with the same sign, so that the
motions of both differ by what the mesh costs (`fenicsrom.assess.errors.estimates.mesh_errors`).
Forces f at the nodes of the structure act on the finer elements as Jᵀ f, where J u are the
displacements u of the finer elements at these nodes.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, SceneError
from fenicsrom.online.kernels.dense import orthonormal
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.subspace import nested_model
from fenicsrom.reduction import stages
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project
from fenicsrom.reduction.derivatives import Selection, all_pairs, combinations, split
from fenicsrom.reduction.load_responses import load_responses, varying_loads
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Basis, Scene

NEXT_INTERFACE_MODES = 10
"""Interface modes beyond those of the basis, where there are any."""

NEXT_MODES = 3
"""Normal modes above those of the basis. Three of a planar beam reach 2.8 times its frequency."""

MISSING_DERIVATIVES = 15
"""Largest number of missing derivatives of the modes of the basis, the largest weights first."""

NEXT_DERIVATIVES = 15
"""Largest number of derivatives of the next modes."""

LOAD_DERIVATIVES = 15
"""Largest number of derivatives of modes along static responses of the basis."""

COMBINATIONS = 8
"""Largest number of combinations of these derivatives. Their energies fall fast."""

INERTIA_LINEAR, INERTIA_NONLINEAR = 12, 6
"""Largest numbers of deflections under inertia forces of deflections, the candidates (2)."""

INDEPENDENT = 1e-3
"""Smaller independent parts of a vector, relative to it in the energy norm, are rounding."""


def most_coordinates(scene: Scene, modes: ComponentModes) -> int:
    """An upper bound of the number of coordinates of (1), known as soon as the modes are.

    Args:
        scene: the scene.
        modes: the component modes of its basis.
    """
    own = modes.vectors.shape[1] + len(modes.loads.labels)
    linear = own + NEXT_MODES + NEXT_INTERFACE_MODES + len(scene.loads)
    if not scene.geometrically_nonlinear:
        return linear + INERTIA_LINEAR
    pairs = own * (own + 1) // 2
    return linear + INERTIA_NONLINEAR + pairs + COMBINATIONS


def candidate_model(structure: Structure, options: Basis, found: stages.Reduction) -> ReducedModel:
    """The larger model of (1).

    Args:
        structure: the structure.
        options: the options of the basis.
        found: the stages of the reduced model.
    """
    extended = extended_basis(structure, options, found)
    return project(structure, extended, structure.geometrically_nonlinear)


def extended_basis(structure: Structure, options: Basis, found: stages.Reduction) -> ReducedBasis:
    """[R, W] of (1), whose first n vectors are those of the basis.

    Arguments as `candidate_model`.
    """
    modes, selection = found.modes, found.selection
    derivatives, basis = found.derivatives, found.basis
    more = _more_modes(structure, options, modes)
    count, masters = modes.omega.size, modes.rows.shape[0]
    left_out = [label for label in modes.labels if label not in selection.modes]
    columns = [modes.labels.index(label) for label in left_out if label.endswith("V")]
    vectors = [modes.normal[:, columns], more.normal[:, count:]]
    labels = [modes.labels[k] for k in columns]
    labels += [f"{k + 1}V" for k in range(count, more.omega.size)]
    vectors.append(more.static[:, masters:])
    labels += [f"{k + 1}S" for k in range(masters, more.rows.shape[0])]
    loaded = structure.factor.solve(structure.load_vectors)
    vectors.append(loaded)
    labels += [f"{k + 1}A" for k in range(loaded.shape[1])]
    pressed = structure.factor.solve(structure.shifting_forces)
    vectors.append(pressed)
    labels += [f"{k + 1}E" for k in range(pressed.shape[1])]

    def extended() -> ReducedBasis:
        """The basis with the vectors so far, orthonormalised against those of the basis."""
        block = np.concatenate([basis.vectors[:, basis.masters :], *vectors], axis=1)
        return build_basis(structure, modes, block, [*basis.labels[basis.masters :], *labels])

    plain = extended()
    normal = np.concatenate([modes.normal, more.normal[:, count:]], axis=1)
    static = [k for k, label in enumerate(plain.labels) if k < masters or label[-1] in "LA"]
    deflections = plain.vectors[:, static]
    deflections = deflections - normal @ structure.mass_inner(normal, deflections)
    known, most = 0, INERTIA_NONLINEAR if structure.geometrically_nonlinear else INERTIA_LINEAR
    while deflections.shape[1] and known < most:
        moved = _moved_by_inertia(structure, modes, plain, deflections)
        vectors.append(moved[:, : most - known])
        labels += [f"{known + k + 1}B" for k in range(vectors[-1].shape[1])]
        known += vectors[-1].shape[1]
        before, plain = plain.size, extended()
        deflections = plain.vectors[:, before:]
    if not structure.geometrically_nonlinear:
        return plain
    further = derivatives.further
    if further is not None:
        vectors.append(further)
        labels += list(derivatives.sizes)[len(derivatives.labels) :]
        plain = extended()
    wanted = missing_derivatives(modes, more, selection, derivatives)
    along = stages.with_loads(more, modes.loads)
    combined = _combinations(structure, options, modes, along, wanted, plain)
    names = [f"{len(derivatives.sizes) + k + 1}D" for k in range(combined.shape[1])]
    vectors = [plain.vectors[:, basis.size :], combined]
    labels = [*plain.labels[basis.size :], *names]
    return extended()


def _moved_by_inertia(
    structure: Structure, modes: ComponentModes, basis: ReducedBasis, deflections: Array
) -> Array:
    """Static deflections (local, j) under the inertia forces of deflections, outside of a basis.

    Those with the largest independent part come first. They depend on what the deflections span and
    not on the axes of the contacts: combinations of the same energy are compared.

    Args:
        structure: the structure.
        modes: the component modes of the basis.
        basis: the basis.
        deflections: (local, k).
    """
    found = modes.inverse.solve(structure.mass_times(deflections))
    gram = structure.inner(found, structure.held_times(found))
    found = orthonormal(found, gram, INDEPENDENT**2)
    moved, independent = combinations(structure, modes, basis, found)
    return moved[:, independent > INDEPENDENT**2]


def missing_derivatives(
    modes: ComponentModes,
    more: ComponentModes,
    selection: Selection,
    derivatives: stages.Derivatives,
) -> tuple[str, ...]:
    """The labels of the derivatives that the candidates combine.

    Args:
        modes: the component modes of the basis.
        more: the component modes with the next normal modes.
        selection: the weights of the derivatives.
        derivatives: the derivatives of the basis.
    """
    kept, weights = set(derivatives.labels), selection.weights
    missing = [label for label in all_pairs(modes.labels) if label not in kept]
    if selection.principal is not None:  # its directions hold the motion of these modes
        missing = []
    missing.sort(key=lambda label: -weights.get(label, 0.0))
    known = set(modes.labels)
    new = [
        label
        for label in all_pairs(more.labels)
        if not known.issuperset(split(label)) and split(label)[1].endswith("V")
    ]
    new.sort(key=lambda label: sum(int(part[:-1]) for part in split(label)))
    loaded = [label for label in stages.load_pairs(modes) if label not in kept][:LOAD_DERIVATIVES]
    return (*missing[:MISSING_DERIVATIVES], *new[:NEXT_DERIVATIVES], *loaded)


def _more_modes(structure: Structure, options: Basis, modes: ComponentModes) -> ComponentModes:
    """The component modes with more normal and interface modes, as far as there are any."""
    held = modes.rows.shape[0] if modes.method == "craig-bampton" else 0
    count, masters = min(modes.omega.size + NEXT_MODES, structure.free - held), options.masters
    # held interface modes would change the fixed normal modes of the Craig-Bampton method
    if isinstance(masters, int) and modes.method == "rubin" and masters == modes.rows.shape[0]:
        masters += NEXT_INTERFACE_MODES
    if masters == "motion":
        masters = modes.rows.shape[0] + NEXT_INTERFACE_MODES
    if (count, masters) == (modes.omega.size, options.masters):
        return modes
    try:
        return component_modes(structure, replace(options, modes=count, masters=masters))
    except (AccuracyError, SceneError):
        return modes


def _combinations(
    structure: Structure,
    options: Basis,
    modes: ComponentModes,
    along: stages.Directions,
    wanted: tuple[str, ...],
    basis: ReducedBasis,
) -> Array:
    """The combinations (local, k) of derivatives with the largest energies outside of a basis."""
    if not wanted:
        return np.zeros((structure.local, 0))
    found = stages.derivatives_along(structure, options, modes, wanted, along)
    x = along.vectors
    # follower pressures may make an energy negative, though not the equilibrium unstable
    sizes = np.sqrt(np.abs(np.diag(structure.inner(x, structure.held_times(x)))))
    size = dict(zip(along.labels, sizes, strict=True))
    for k, label in enumerate(wanted):
        first, second = split(label)
        found[:, k] /= size[first] * size[second]
    return combinations(structure, modes, basis, found)[0][:, :COMBINATIONS]


def finer_model(
    structure: Structure, finer: Any, options: Basis, found: stages.Reduction
) -> tuple[ReducedModel, tuple[str, ...], Array]:
    """The reduced model of finer elements, in the coordinates of the model of a structure.

    A vector that depends on the others on the finer elements is no coordinate of this model.

    Args:
        structure: the structure.
        finer: the same structure with finer elements; its method `lifted` gives Jᵀ f (local, k) of
            forces f (local of the structure, k).
        options: the options of the basis.
        found: the stages of the reduced model of the structure.

    Returns:
        The model, the labels of its coordinates, and the frequencies (v,) of the normal modes,
        those that are no coordinates included, Hz.

    Raises:
        ConvergenceError, AccuracyError, SceneError: a stage failed.
    """

    def signs(ours: Array, theirs: Array) -> Array:
        """The signs (k,) of the mass products of vectors of the structure with finer ones."""
        lifted = finer.lifted(structure.mass_times(ours))
        products = structure.comm.allreduce(np.sum(lifted * theirs, axis=0))
        return np.where(products < 0.0, -1.0, 1.0)

    modes = component_modes(finer, replace(options, modes=found.modes.omega.size))
    loads = found.modes.loads  # the same responses, even if these modes leave out less of a load
    columns = [f"{number + 1}L" in loads.labels for number in varying_loads(finer)]
    modes = replace(
        modes,
        normal=modes.normal * signs(found.modes.normal, modes.normal),
        loads=replace(loads, vectors=load_responses(finer)[:, columns]),
    )
    selection = _moved(structure, found.modes, modes, found.selection)
    derivatives = stages.differentiate(finer, options, modes, selection)
    if selection.principal is not None:  # as many combinations as the basis has
        count = len(found.derivatives.labels)
        vectors = np.concatenate([derivatives.vectors, derivatives.further], axis=1)[:, :count]
        derivatives = stages.Derivatives(found.derivatives.labels[: vectors.shape[1]], vectors)
    basis = stages.enrich(finer, modes, selection, derivatives)
    if basis.labels == found.basis.labels:
        turned = signs(found.basis.vectors, basis.vectors)
        basis = replace(basis, vectors=basis.vectors * turned)
    common = [k for k, label in enumerate(basis.labels) if label in found.basis.labels]
    model = nested_model(project(finer, basis, finer.geometrically_nonlinear), common)
    return model, tuple(basis.labels[k] for k in common), modes.frequencies_hz


def _moved(
    structure: Structure, modes: ComponentModes, finer: ComponentModes, selection: Selection
) -> Selection:
    """The selection with its principal directions made of the modes of the finer elements."""
    principal = selection.principal
    if principal is None:
        return selection
    x, p = modes.vectors, principal.vectors
    size = np.sqrt(np.diag(structure.mass_inner(x, x)))
    gram = structure.mass_inner(x / size, x / size)
    parts = np.linalg.lstsq(gram, structure.mass_inner(x / size, p), rcond=None)[0]
    moved = finer.vectors @ (parts / size[:, None])
    return replace(selection, principal=replace(principal, vectors=moved))

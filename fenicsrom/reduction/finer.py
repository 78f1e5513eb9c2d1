"""The reduced model of finer elements, which judges the mesh.

It has the same modes and derivatives as the model of the run, each with the same sign, so that the
motions of both differ by what the mesh costs (`fenicsrom.assess.errors.estimates.mesh_errors`).
Forces f at the nodes of the structure act on the finer elements as Jᵀ f, where J u are the
displacements u of the finer elements at these nodes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.projection import project
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.selection import Selection
from fenicsrom.reduction.stages import Derivatives, Reduction, differentiate, enrich
from fenicsrom.scene import Basis


def finer_model(structure: Structure, finer: Any, options: Basis, found: Reduction) -> ReducedModel:
    """The reduced model of finer elements, in the coordinates of the model of a structure.

    Args:
        structure: the structure.
        finer: the same structure with finer elements; its method `lifted` gives Jᵀ f (local, k) of
            forces f (local of the structure, k).
        options: the options of the basis.
        found: the stages of the reduced model of the structure.

    Raises:
        ConvergenceError, AccuracyError, SceneError: a stage failed.
    """

    def signs(ours: Array, theirs: Array) -> Array:
        """The signs (k,) of the mass products of vectors of the structure with finer ones."""
        lifted = finer.lifted(structure.mass_times(ours))
        products = structure.comm.allreduce(np.sum(lifted * theirs, axis=0))
        return np.where(products < 0.0, -1.0, 1.0)

    modes = component_modes(finer, replace(options, modes=found.modes.omega.size))
    modes = replace(modes, normal=modes.normal * signs(found.modes.normal, modes.normal))
    selection = _moved(structure, found.modes, modes, found.selection)
    derivatives = differentiate(finer, options, modes, selection)
    if selection.principal is not None:  # as many combinations as the basis has
        count = len(found.derivatives.labels)
        vectors = np.concatenate([derivatives.vectors, derivatives.further], axis=1)[:, :count]
        derivatives = Derivatives(found.derivatives.labels[: vectors.shape[1]], vectors)
    basis = enrich(finer, modes, selection, derivatives)
    if basis.labels == found.basis.labels:
        turned = signs(found.basis.vectors, basis.vectors)
        basis = replace(basis, vectors=basis.vectors * turned)
    return project(finer, basis, finer.geometrically_nonlinear)


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

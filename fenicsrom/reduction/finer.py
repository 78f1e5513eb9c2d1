"""The reduced model of a finer discretisation, which judges the mesh.

It has the same modes and derivatives as the model of the run, by their labels, each with the same
sign. Its motion therefore differs from that of the run by what the mesh costs
(`fenicsrom.assess.errors.estimates.mesh_errors`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.projection import project
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.stages import Reduction, differentiate, enrich
from fenicsrom.scene import Basis


class Finer(Structure, Protocol):
    """A structure that is discretised better than another one."""

    def coarsened(self, block: Array) -> Array:
        """The displacements (local of the other structure, k) of a block (local, k)."""


def finer_model(
    structure: Structure, finer: Finer, options: Basis, found: Reduction
) -> ReducedModel:
    """The reduced model of a finer structure, with the modes and derivatives of a structure.

    Args:
        structure: the structure.
        finer: the same structure, discretised better.
        options: the options of the basis.
        found: the stages of the reduced model of the structure.

    Raises:
        ConvergenceError, AccuracyError: a stage failed.
    """
    modes = component_modes(finer, replace(options, modes=found.modes.omega.size))
    products = structure.mass_inner(found.modes.normal, finer.coarsened(modes.normal))
    modes = replace(modes, normal=modes.normal * np.where(np.diag(products) < 0.0, -1.0, 1.0))
    derivatives = differentiate(finer, options, modes, found.derivatives.labels)
    basis = enrich(finer, modes, found.selection, derivatives)
    return project(finer, basis, finer.geometrically_nonlinear)

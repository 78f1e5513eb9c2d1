"""The stages from a structure to its reduced model.

    structure → modes → selection → derivatives → basis → reduced model

Each stage is one function. `Reduction` runs a stage when its result is first needed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.dense_model import DenseModel
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.reduction.basis import ReducedBasis, build_basis
from fenicsrom.reduction.derivatives import all_pairs, modal_derivatives
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.projection import project, project_intrusively
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.selection import Selection, modal_coordinates, select
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.scene import Basis, Scene


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Modal derivatives.

    Attributes:
        labels: (k,) labels, such as 1V2S.
        vectors: (local, k).
    """

    labels: tuple[str, ...]
    vectors: Array


def choose(
    structure: Structure, scene: Scene, modes: ComponentModes, snapshots: Snapshots | None = None
) -> Selection:
    """Select the modes and derivatives that the scene's [basis] asks for.

    Args:
        structure: the structure.
        scene: [basis] holds the options; the other tables define the snapshots.
        modes: component modes of the structure.
        snapshots: snapshots of these modes, if the caller has them.

    Returns:
        The selection.

    Raises:
        ConvergenceError: the linear transient or the nonlinear statics did not converge.
    """
    wanted = scene.basis.derivatives
    if (
        not structure.geometrically_nonlinear
        or wanted == "none"
        or (wanted in ("mmi", "mmi-nls") and scene.static_only)
    ):
        return Selection(modes.labels, (), {}, {})
    if wanted == "all":
        return Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
    if not isinstance(wanted, str):
        return Selection(modes.labels, wanted, {}, {})
    snapshots = snapshots or Snapshots(structure, scene, modes)
    linear = snapshots.linear
    static = snapshots.static if wanted == "mmi-nls" else linear.vectors[:, :0]
    found = modal_coordinates(
        modes.vectors,
        np.concatenate([static, linear.vectors], axis=1),
        structure.mass_inner,
        structure.largest(modes.vectors),
    )
    held, moving = np.split(found, [static.shape[1]], axis=1)
    coordinates = np.concatenate([held, moving @ linear.coordinates], axis=1)
    return select(coordinates, modes.labels, wanted, scene.basis.threshold)


def differentiate(
    structure: Structure, options: Basis, modes: ComponentModes, labels: tuple[str, ...]
) -> Derivatives:
    """Compute modal derivatives.

    Args:
        structure: the structure.
        options: how the tangent is differentiated.
        modes: component modes of the structure.
        labels: (k,) labels of the derivatives.

    Returns:
        The derivatives.

    Raises:
        AccuracyError: a derivative is not symmetric.
    """
    exact = options.differentiation == "exact"
    derivative = structure.tangent_derivative if exact else structure.tangent_difference
    vectors = modal_derivatives(
        modes.vectors, modes.labels, labels, derivative, modes.inverse, structure.comm.allreduce
    )
    return Derivatives(labels, vectors)


def enrich(
    structure: Structure, modes: ComponentModes, selection: Selection, derivatives: Derivatives
) -> ReducedBasis:
    """Build the basis of the selected modes, the responses to loads and the derivatives.

    Raises:
        AccuracyError: the basis lost its orthogonality.
    """
    kept = [
        k
        for k, label in enumerate(modes.labels)
        if label.endswith("V") and label in selection.modes
    ]
    vectors = np.concatenate(
        [modes.normal[:, kept], modes.loads.vectors, derivatives.vectors], axis=1
    )
    labels = [*(modes.labels[k] for k in kept), *modes.loads.labels, *derivatives.labels]
    return build_basis(
        modes.method,
        modes.masters,
        modes.rows,
        vectors,
        labels,
        structure.mass_inner,
        structure.comm.allreduce,
    )


def reduce(structure: Structure, options: Basis, basis: ReducedBasis) -> ReducedModel | DenseModel:
    """Build the reduced model.

    Args:
        structure: the structure.
        options: `elastic_force` selects the polynomial or the projection of the full force.
        basis: the basis.

    Returns:
        The reduced model; linear if the structure is geometrically linear.

    Raises:
        SceneError: the options ask for the polynomial, but the elastic force is not a polynomial.
    """
    if structure.geometrically_nonlinear and options.elastic_force == "projection":
        return project_intrusively(structure, basis)
    return project(structure, basis, structure.geometrically_nonlinear)


Timer = Callable[[str], AbstractContextManager[None]]


class Reduction:
    """The stages from a structure to its reduced model; each runs when it is first read.

    The properties state which stage needs which other stage, once for the whole program.
    """

    def __init__(
        self,
        structure: Structure,
        scene: Scene,
        timed: Timer,
        modes: ComponentModes | None = None,
        snapshots: Snapshots | None = None,
    ):
        """Store the arguments.

        Args:
            structure: the structure.
            scene: the scene; its [basis] holds the options of the stages.
            timed: gives a context that times the stage of a name.
            modes: component modes of the structure, if the caller has them.
            snapshots: snapshots of these modes, if the caller has them.
        """
        self._structure, self._scene, self._timed = structure, scene, timed
        self._snapshots = snapshots
        if modes is not None:
            self.modes = modes

    @cached_property
    def modes(self) -> ComponentModes:
        """The component modes."""
        with self._timed("modes"):
            return component_modes(self._structure, self._scene.basis)

    @cached_property
    def selection(self) -> Selection:
        """The selected modes and derivatives."""
        modes = self.modes
        with self._timed("selection"):
            return choose(self._structure, self._scene, modes, self._snapshots)

    @cached_property
    def derivatives(self) -> Derivatives:
        """The modal derivatives of the selection."""
        modes, selection = self.modes, self.selection
        with self._timed("derivatives"):
            return differentiate(self._structure, self._scene.basis, modes, selection.derivatives)

    @cached_property
    def basis(self) -> ReducedBasis:
        """The basis of the selected modes and derivatives."""
        modes, selection, derivatives = self.modes, self.selection, self.derivatives
        with self._timed("basis"):
            return enrich(self._structure, modes, selection, derivatives)

    @cached_property
    def model(self) -> ReducedModel | DenseModel:
        """The reduced model."""
        basis = self.basis
        with self._timed("reduction"):
            return reduce(self._structure, self._scene.basis, basis)

"""The stages from a structure to its reduced model.

    structure → modes → selection → derivatives → basis → reduced model

Each stage is one function. `Reduction` runs a stage when its result is first needed.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.reduction import derivatives as modal
from fenicsrom.reduction import interface
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project, project_intrusively
from fenicsrom.reduction.load_responses import LoadVectors
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.scene import Basis, Scene
from fenicsrom.scene.base.rules import BY_MOTION

FURTHER = 8
"""Combinations of derivatives beyond those of the basis: candidates of a larger one."""


class Directions(NamedTuple):
    """Directions of derivatives: (k,) labels, such as 1V and 1L, and vectors (local, k)."""

    labels: tuple[str, ...]
    vectors: Array


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Modal derivatives of a basis.

    Attributes:
        labels: (k,) labels: 1V2S of a pair of modes, or 1D, 2D, ... of combinations of derivatives
            along principal directions.
        vectors: (local, k).
        further: (local, j) the next combinations, which the basis leaves out.
        sizes: of all combinations in the energy norm, relative to the motion, by their labels.
    """

    labels: tuple[str, ...]
    vectors: Array
    further: Array | None = None
    sizes: dict[str, float] = field(default_factory=dict)


def choose(
    structure: Structure, scene: Scene, modes: ComponentModes, snapshots: Snapshots | None = None
) -> modal.Selection:
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
        or modes.rigid
        or (wanted in BY_MOTION and scene.static_only)
    ):
        return modal.Selection(modes.labels, (), {}, {})
    if wanted == "all":
        pairs = (*modal.all_pairs(modes.labels), *load_pairs(modes))
        return modal.Selection(modes.labels, pairs, {}, {})
    if not isinstance(wanted, str):
        return modal.Selection(modes.labels, wanted, {}, {})
    snapshots = snapshots or Snapshots(structure, scene, modes)
    linear = snapshots.linear
    static = linear.vectors[:, :0] if wanted == "mmi" else snapshots.static
    scale = structure.largest(modes.vectors)
    found = modal.modal_coordinates(
        modes.vectors, np.concatenate([static, linear.vectors], axis=1), structure.mass_inner, scale
    )
    held, moving = np.split(found, [static.shape[1]], axis=1)
    coordinates = np.concatenate([held, moving @ linear.coordinates], axis=1)
    if wanted != "principal":
        return modal.select(coordinates, modes.labels, wanted, scene.basis.threshold)
    coordinates = np.concatenate([coordinates, moving @ snapshots.mode], axis=1)
    selected = modal.select(coordinates, modes.labels, wanted, scene.basis.threshold)
    if not coordinates.any():
        return selected
    rest = _rest(scene.basis)
    principal = modal.principal_directions(structure, modes.vectors / scale, coordinates, rest)
    return replace(selected, derivatives=(), weights={}, principal=principal)


def _rest(options: Basis) -> float:
    """ε of the principal directions and derivatives."""
    return interface.REST if options.masters == "motion" else modal.REST


def load_pairs(modes: ComponentModes) -> list[str]:
    """The labels of the derivatives of normal modes along the static responses of a basis: 1V2L."""
    normal = [label for label in modes.labels if label.endswith("V")]
    return [mode + load for mode in normal for load in modes.loads.labels]


def with_loads(modes: ComponentModes, loads: LoadVectors) -> Directions:
    """Component modes, then static responses to loads."""
    vectors = np.concatenate([modes.vectors, loads.vectors], axis=1)
    return Directions((*modes.labels, *loads.labels), vectors)


def derivatives_along(
    structure: Structure,
    options: Basis,
    modes: ComponentModes,
    labels: tuple[str, ...],
    along: modal.PrincipalDirections | Directions | None = None,
) -> Array:
    """Compute modal derivatives, along modes or along other directions.

    Args:
        structure: the structure.
        options: how the tangent is differentiated.
        modes: component modes of the structure.
        labels: (k,) labels of the derivatives.
        along: the directions that the labels name; by default the modes.

    Returns:
        The derivatives (local, k).
    """
    exact = options.differentiation == "exact"
    derivative = structure.tangent_derivative if exact else structure.tangent_difference
    given = along or modes
    return modal.modal_derivatives(given.vectors, given.labels, labels, derivative, modes.inverse)


def differentiate(
    structure: Structure,
    options: Basis,
    modes: ComponentModes,
    selection: modal.Selection | tuple[str, ...],
) -> Derivatives:
    """Compute the derivatives of a basis.

    Those along principal directions are combined; combinations that together hold less than the
    square of ε of the energy of the motion stay out of the basis.

    Args:
        structure: the structure.
        options: how the tangent is differentiated.
        modes: component modes of the structure.
        selection: what `choose` selected, or (k,) labels of pairs of modes.
    """
    if not isinstance(selection, modal.Selection):
        selection = modal.Selection(modes.labels, selection, {}, {})
    principal, labels = selection.principal, selection.derivatives
    if principal is None:
        directions = with_loads(modes, modes.loads)
        return Derivatives(labels, derivatives_along(structure, options, modes, labels, directions))
    linear = enrich(structure, modes, selection, Derivatives((), modes.normal[:, :0]))
    weights = principal.weights()
    found = derivatives_along(structure, options, modes, tuple(weights), principal)
    found *= list(weights.values())
    vectors, energies = modal.combinations(structure, modes, linear, found)
    count = modal.enough(energies, _rest(options) ** 2 * principal.energy)
    vectors, energies = vectors[:, : count + FURTHER], energies[: count + FURTHER]
    labels = tuple(f"{k + 1}D" for k in range(energies.size))
    sizes = dict(zip(labels, np.sqrt(energies / principal.energy).tolist(), strict=True))
    return Derivatives(labels[:count], vectors[:, :count], vectors[:, count:], sizes)


def enrich(
    structure: Structure,
    modes: ComponentModes,
    selection: modal.Selection,
    derivatives: Derivatives,
) -> ReducedBasis:
    """Build the basis of the selected modes, the responses to loads and the derivatives.

    Raises:
        AccuracyError: the basis lost its orthogonality.
    """
    numbered = enumerate(modes.labels)
    kept = [k for k, name in numbered if name.endswith("V") and name in selection.modes]
    blocks = modes.normal[:, kept], modes.loads.vectors, derivatives.vectors
    vectors = np.concatenate(blocks, axis=1)
    labels = [*(modes.labels[k] for k in kept), *modes.loads.labels, *derivatives.labels]
    return build_basis(structure, modes, vectors, labels)


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
    def selection(self) -> modal.Selection:
        """The selected modes and derivatives."""
        modes = self.modes
        with self._timed("selection"):
            return choose(self._structure, self._scene, modes, self._snapshots)

    @cached_property
    def derivatives(self) -> Derivatives:
        """The modal derivatives of the selection."""
        modes, selection = self.modes, self.selection
        with self._timed("derivatives"):
            return differentiate(self._structure, self._scene.basis, modes, selection)

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

"""From a structure to its reduced model, stage by stage."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.basis import ReducedBasis, build_basis
from fenicsrom.reduction.derivatives import all_pairs, modal_derivatives
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.projection import project, project_intrusively
from fenicsrom.reduction.selection import Selection, modal_coordinates, select
from fenicsrom.reduction.snapshots import Snapshots

if TYPE_CHECKING:
    from fenicsrom.reduction.modes import Structure


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Modal derivatives by label: vectors (local, k)."""

    labels: tuple[str, ...]
    vectors: Array


def choose(
    solid: Structure, modes: ComponentModes, snapshots: Snapshots | None = None
) -> Selection:
    """Choose the modes and derivatives the scene's [basis] asks for.

    Args:
        solid: the body.
        modes: its component modes.
        snapshots: of these modes, where some are known already.

    Raises:
        ConvergenceError: the linear transient or the nonlinear statics did not converge.
    """
    scene = solid.scene
    wanted = scene.basis.derivatives
    if (
        not scene.geometrically_nonlinear
        or wanted == "none"
        or (wanted in ("mmi", "mmi-nls") and scene.static_only)
    ):
        return Selection(modes.labels, (), {}, {})
    if wanted == "all":
        return Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
    if not isinstance(wanted, str):
        return Selection(modes.labels, wanted, {}, {})
    snapshots = snapshots or Snapshots(solid, modes)
    deflections = snapshots.linear
    if wanted == "mmi-nls":
        deflections = np.concatenate([snapshots.static, deflections], axis=1)
    coordinates = modal_coordinates(
        modes.vectors, deflections, solid.mass_inner, solid.largest(modes.vectors)
    )
    return select(coordinates, modes.labels, wanted, scene.basis.threshold)


def differentiate(solid: Structure, modes: ComponentModes, labels: tuple[str, ...]) -> Derivatives:
    """Solve for the modal derivatives of these labels.

    Raises:
        AccuracyError: a derivative is not symmetric.
    """
    exact = solid.scene.basis.differentiation == "exact"
    derivative = solid.tangent_derivative if exact else solid.tangent_difference
    total = solid.comm.allreduce
    return Derivatives(
        labels,
        modal_derivatives(modes.vectors, modes.labels, labels, derivative, modes.inverse, total),
    )


def enrich(
    solid: Structure, modes: ComponentModes, selection: Selection, derivatives: Derivatives
) -> ReducedBasis:
    """The basis of the selected modes and derivatives."""
    kept = [
        k
        for k, label in enumerate(modes.labels)
        if label.endswith("V") and label in selection.modes
    ]
    vectors = np.concatenate([modes.normal[:, kept], derivatives.vectors], axis=1)
    labels = [modes.labels[k] for k in kept] + list(derivatives.labels)
    return build_basis(
        modes.method,
        modes.masters,
        modes.rows,
        vectors,
        labels,
        solid.mass_inner,
        solid.comm.allreduce,
    )


def reduce(solid: Structure, basis: ReducedBasis) -> Any:
    """The reduced model the scene's `basis.elastic_force` asks for: polynomial, or projection of
    the full force.
    """
    scene = solid.scene
    if scene.geometrically_nonlinear and scene.basis.elastic_force == "projection":
        return project_intrusively(solid, basis)
    return project(solid, basis, scene.geometrically_nonlinear)


Timer = Callable[[str], AbstractContextManager[None]]


class Reduction:
    """From a body to its reduced model, stage by stage: each is gone through, and timed, when it is
    first asked for.

    This is the one statement of what the stages need of one another: `run`, `fenicsrom modes` and
    `fenicsrom compare` ask for as much as they want.
    """

    def __init__(
        self,
        body: Structure,
        timed: Timer,
        modes: ComponentModes | None = None,
        snapshots: Snapshots | None = None,
    ):
        """Start from a body and the scene it has, with its modes (and snapshots of these) where
        they are known already.
        """
        self._body, self._timed, self._snapshots = body, timed, snapshots
        if modes is not None:
            self.modes = modes

    @cached_property
    def modes(self) -> ComponentModes:
        """The component modes."""
        wanted = self._body.scene.basis
        with self._timed("modes"):
            return component_modes(self._body, wanted.method, wanted.modes)

    @cached_property
    def selection(self) -> Selection:
        """The modes and derivatives that are kept."""
        modes = self.modes
        with self._timed("selection"):
            return choose(self._body, modes, self._snapshots)

    @cached_property
    def derivatives(self) -> Derivatives:
        """These derivatives."""
        modes, selection = self.modes, self.selection
        with self._timed("derivatives"):
            return differentiate(self._body, modes, selection.derivatives)

    @cached_property
    def basis(self) -> ReducedBasis:
        """The basis of both."""
        modes, selection, derivatives = self.modes, self.selection, self.derivatives
        with self._timed("basis"):
            return enrich(self._body, modes, selection, derivatives)

    @cached_property
    def model(self) -> Any:
        """The reduced model on it."""
        basis = self.basis
        with self._timed("reduction"):
            return reduce(self._body, basis)

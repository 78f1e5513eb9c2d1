"""The joined basis of some speeds of rotation, and the range model on it.

At each speed Ω_k the body has an equilibrium u_k, normal modes Φ_k, attachment modes
G_k = K_k⁻¹ B W and modal derivatives θ_k of all pairs of normal modes. The displacement about the
unloaded shape is

    u = R q,    R = [R_m, all u_k, all Φ_k, all G_k, all θ_k],    (1)

with one W for all speeds, and with R_m = G (Bᵀ G)⁻¹ of one speed; every other vector v enters as
v − R_m Bᵀ v (`fenicsrom.reduction.basis`). Without the u_k nothing would stiffen at speed. The
derivatives say how equilibrium and modes change between the speeds.

A Galerkin model contains every equilibrium and every mode of the solid that its basis contains.
Against the solid at a speed between those of the basis, the model therefore has the error that one
speed more in the basis would remove.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.online.step.speed_range import RangeErrors, RangeModel
from fenicsrom.progress import log
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project, projected_gyroscopic
from fenicsrom.reduction.candidates import NEXT_MODES
from fenicsrom.reduction.derivatives import all_pairs, modal_derivatives
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.scene import Basis

DEPENDENCE = 1e-5
"""A vector is left out of the joined basis if its independent part is at most this.

At 1e-3 a joined basis misses its own speeds by up to 3e-4.
"""

LARGEST = 120
"""Largest number of coordinates: the cubic force of n = 120 takes 0.4 GB, as n⁴."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a structure shows at one speed.

    Attributes:
        omega: the speed, rad/s.
        equilibrium: (local, 1) u, m.
        squares: (v,) ω² of the normal modes.
        modes: (local, v) normal modes.
        attached: (local, m) attachment modes of the masters.
        derivatives: (local, v (v + 1) / 2) of all pairs of modes; none between the speeds.
        flexibility: (m, m) of the masters.
    """

    omega: float
    equilibrium: Array
    squares: Array
    modes: Array
    attached: Array
    derivatives: Array
    flexibility: Array


def range_model(
    structure: Any, options: Basis, speeds: Array, nominal: float | None = None
) -> RangeModel:
    """The range model of a structure, with its errors between the speeds.

    Args:
        structure: a `fenicsrom.fem.solid.solid.Solid`; afterwards it is unloaded.
        options: the options of the basis.
        speeds: (s,) speeds of the basis, ascending, rad/s.
        nominal: the speed of the stiffness and the modes of the damping, rad/s; None takes the
            last speed.

    Raises:
        ConvergenceError, AccuracyError: no equilibrium at a speed, or an inaccurate mode.
        SceneError: there are too many coordinates.
    """
    middle = speeds[speeds.size // 2]
    if structure.rotation.omega != middle:
        structure.spin(float(middle))
    first = component_modes(structure, options)
    more = min(first.omega.size + NEXT_MODES, structure.free)
    next_modes = structure.eigenmodes(structure.factor, more)[1][:, first.omega.size :]
    extra = [next_modes, structure.factor.solve(structure.load_vectors)]
    if structure.interface is not None and options.masters == "motion":  # to judge the others
        further = structure.contact_rows.T @ structure.interface[:, first.rows.shape[0] :]
        extra.append(structure.factor.solve(further))
    seen = {}
    between = 0.5 * (speeds[1:] + speeds[:-1])
    for omega in map(float, [middle, *sorted({*speeds, *between} - {middle})]):
        log.info(f"  {30.0 / np.pi * omega:g} rpm ..")
        if omega != structure.rotation.omega:
            structure.spin(omega)
        seen[omega] = _see(structure, first, omega, with_derivatives=omega in speeds)
    at = [seen[omega] for omega in speeds]
    vectors = [one.equilibrium for one in at] + [one.modes for one in at]
    vectors += [one.attached for one in at if one.omega != middle]
    vectors += [one.derivatives for one in at] + extra
    blocks = np.concatenate(vectors, axis=1)
    labels = [f"{k + 1}J" for k in range(blocks.shape[1])]
    basis = build_basis(structure, first, blocks, labels, DEPENDENCE)
    if basis.size > LARGEST:
        reason = f"the joined basis has {basis.size} coordinates, at most {LARGEST} are allowed; "
        reason += "use fewer basis.modes, basis.masters or speeds"
        raise refuse(structure.source, reason, ErrorKind.RANGE, "rotation.speeds_rpm")
    log.info(f"  polynomial of {basis.size} coordinates ..")
    return _projected(structure, basis, first, at, [seen[o] for o in sorted(seen)], nominal)


def _see(structure: Any, first: ComponentModes, omega: float, with_derivatives: bool) -> _Seen:
    """What a structure shows at its present speed, with the masters of one speed."""
    count = first.omega.size
    squares, modes = structure.eigenmodes(structure.factor, count)
    labels = [f"{k + 1}V" for k in range(count)]
    pairs = all_pairs(labels) if with_derivatives else []
    attached = structure.factor.solve(np.ascontiguousarray(first.rows.T))
    derivative = structure.tangent_derivative
    found = modal_derivatives(modes, labels, pairs, derivative, structure.factor)
    equilibrium = structure.equilibrium[:, None].copy()
    flexibility = structure.inner(first.rows.T, attached)
    return _Seen(omega, equilibrium, squares, modes, attached, found, flexibility)


def _projected(
    structure: Any,
    basis: ReducedBasis,
    first: ComponentModes,
    at: list[_Seen],
    seen: list[_Seen],
    nominal: float | None,
) -> RangeModel:
    """The range model on a basis, with its errors at the speeds between those of the basis."""
    r, frame = basis.vectors, structure.rotation
    coriolis = projected_gyroscopic(structure, r)
    if coriolis.size:
        coriolis /= frame.omega
    force = structure.inner(r, frame.unit_centrifugal_force[:, None])[:, 0]
    softening = structure.inner(r, frame.mass_times(r))
    if nominal is not None and structure.viscous.acts:
        structure.spin(nominal)
    structure.unload()
    model = project(structure, basis)
    known = np.concatenate([one.equilibrium for one in at], axis=1)
    equilibria = np.linalg.solve(model.mass, structure.mass_inner(r, known)).T
    found = RangeModel(
        model=model,
        centrifugal=force,
        softening=softening,
        coriolis=coriolis,
        euler=structure.inner(r, frame.unit_euler_force[:, None])[:, 0],
        inertia=np.array([frame.inertia]),
        moments=structure.load_moments(r),
        speeds=np.array([one.omega for one in at]),
        equilibria=np.asarray(equilibria, np.float64),
        modes=first.omega.size,
        masters=first.rows.shape[0],
        errors=RangeErrors(*np.zeros((4, 0))),
        contacts=structure.contacts if structure.joined else None,
    )
    between = [one for one in seen if one.omega not in found.speeds]
    errors = [_errors(structure, r, found, one) for one in between]
    return replace(found, errors=RangeErrors(*np.array(errors).T))


def _errors(structure: Any, r: Array, found: RangeModel, seen: _Seen) -> tuple[float, ...]:
    """The speed, and the errors of `RangeErrors` against what the structure shows there."""

    def size(vector: Array) -> float:
        return float(np.sqrt(structure.mass_inner(vector, vector)[0, 0]))

    q = found.equilibrium(seen.omega)
    tangent = found.tangent(seen.omega, q)
    squares = scipy.linalg.eigh(tangent, found.model.mass, eigvals_only=True)
    frequencies = np.sqrt(np.abs(squares[: seen.squares.size] / seen.squares))
    m, moved = found.masters, size(seen.equilibrium)
    flexibility = np.linalg.inv(tangent)[:m, :m] - seen.flexibility
    return (
        seen.omega,
        size(r @ q[:, None] - seen.equilibrium) / moved if moved > 0.0 else 0.0,
        float(np.max(np.abs(frequencies - 1.0))),
        float(np.linalg.norm(flexibility) / np.linalg.norm(seen.flexibility)) if m else 0.0,
    )

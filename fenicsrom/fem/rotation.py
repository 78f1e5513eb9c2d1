"""What a frame that turns steadily about an axis adds to a body: centrifugal and Coriolis force.

Seen from a frame of angular velocity Omega e through the point a, with P = I - e e^T, the body X +
u has the potential

    V(u) = -1/2 Omega^2 int rho |P (X + u - a)|^2 = V(0) - Omega^2 (c . u + 1/2 u . Q u),
    c . v = int rho P (X - a) . v,    v . Q u = int rho P u . v

Its force Omega^2 (c + Q u) is the centrifugal load and, by Q, spin softening. The Coriolis force is
-G du/dt, where v . G w = 2 Omega int rho v . (e x w) is skew: it does no work. (For a beam: Wright
et al., J. Appl. Mech. 49, 1982.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.fem.linalg import multiply
from fenicsrom.scene import Rotation


class RotatingFrame:
    """Centrifugal and Coriolis terms of a body, for any angular velocity.

    Attributes:
        omega: angular velocity in rad/s.
        square: Omega^2 of the centrifugal force in rad^2/s^2; load steps take it from one speed to
        another.
        mass: Q, the mass matrix of the motion normal to the axis, kg.
        pull: (local,) c, kg m.
    """

    def __init__(
        self,
        rotation: Rotation,
        space: fem.FunctionSpace,
        density: Any,
        assemble_matrix: Callable[[Any], PETSc.Mat],
        assemble_vector: Callable[[Any], Array],
    ):
        """Form c, Q and, if the Coriolis force is wanted, G.

        Args:
            rotation: the axis.
            space: of the displacements.
            density: UFL measure weighted with the density (and the thickness in 2D).
            assemble_matrix: of a UFL form, zero on the clamped rows.
            assemble_vector: of a UFL form, (local,), zero on the clamped unknowns.
        """
        d = space.mesh.geometry.dim
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        point = ufl.as_vector([float(value) for value in rotation.point or (0.0,) * d])
        if rotation.axis is None:
            normal = ufl.Identity(d)
            turned = ufl.as_vector([-trial[1], trial[0]])
        else:
            axis = ufl.as_vector([float(value) for value in rotation.axis])
            normal = ufl.Identity(d) - ufl.outer(axis, axis)
            turned = ufl.cross(axis, trial)
        self.pull = assemble_vector(
            density(ufl.dot(normal * (ufl.SpatialCoordinate(space.mesh) - point), test))
        )
        self.mass = assemble_matrix(density(ufl.dot(normal * trial, test)))
        self._unit = (
            assemble_matrix(density(2.0 * ufl.dot(turned, test))) if rotation.coriolis else None
        )
        self._comm = space.mesh.comm
        self.turn(rotation.omega)

    def turn(self, omega: float) -> None:
        """Set the angular velocity, rad/s."""
        self.omega, self.square = omega, omega**2

    def force(self, u: Array) -> Array:
        """Centrifugal force (local,) at a displacement (local,), N."""
        return self.square * (self.pull + multiply(self.mass, u))

    def mass_times(self, block: Array) -> Array:
        """Q times the columns of a block (local, k)."""
        return multiply(self.mass, block)

    def energy(self, u: Array) -> float:
        """Centrifugal potential V(u) - V(0), J."""
        return float(
            self._comm.allreduce(
                -self.square * float(np.dot(u, self.pull + 0.5 * multiply(self.mass, u)))
            )
        )

    def soften(self, matrix: PETSc.Mat, weight: float) -> None:
        """Add a multiple of the potential's second derivative, -Omega^2 Q, to a tangent
        stiffness.
        """
        matrix.axpy(
            -weight * self.square, self.mass, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        )

    def gyroscopic(self) -> PETSc.Mat | None:
        """G at this speed, N s/m; None where the Coriolis force is not wanted."""
        if self._unit is None:
            return None
        matrix = self._unit.copy()
        matrix.scale(self.omega)
        return matrix

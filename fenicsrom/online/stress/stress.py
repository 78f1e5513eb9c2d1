"""Stresses of a reduced model at the Gauss points of its mesh and at the vertices of its cells.

The displacement u = u₀ + Σ q_k φ_k is linear in the coordinates q, and so is its gradient H. The
table of the gradients of u₀ and of every φ_k at the Gauss points therefore gives the strain and the
stress at every q without a mesh:

    F = I + H,    E = sym H + ½ Hᵀ H,    S = C E,    σ = F S Fᵀ / det F,    (1)

with the elasticity tensor C, the second Piola-Kirchhoff stress S and the Cauchy stress σ.
S is a quadratic polynomial in q, and its coefficients could be tabulated instead. With n
coordinates they take ½ (n + 1) (n + 2) columns of 6 components in place of n + 1 columns of 9, give
the same numbers to round-off, and do not give F, which the Cauchy stress needs.

A geometrically linear model has the stress that is linear about its equilibrium. Plane strain adds
S_zz = C_zz : E, and plane stress F_zz = √(1 + 2 E_zz), which follows from S_zz = 0.

The Gauss points are those of the rule with k points in every direction for cells of degree k (k
points to a side of a simplex), at which the stresses of a finite-element solution are most
accurate (Barlow, International Journal for Numerical Methods in Engineering 10, 1976, 243-251). To
the vertices, each component of the stress is extrapolated by the polynomial of degree k - 1 through
the Gauss points of a cell, and the mean is taken over the cells that meet there. The extrapolated
stress is a mean of the values at the vertices everywhere in a cell, so that the von Mises stress,
a convex function, is largest at a vertex.

Symmetric tensors have six components in the order of VTK: xx, yy, zz, xy, yz, xz; Pa.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.stress.elasticity_tensor import across, mandel_basis, stiffness
from fenicsrom.scene import Elasticity, Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array

ROWS, COLUMNS = (0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2)

CAUCHY = "cauchy"
SECOND_PIOLA_KIRCHHOFF = "second-piola-kirchhoff"
MEASURES = (SECOND_PIOLA_KIRCHHOFF, CAUCHY)


@dataclass(frozen=True)
class StressLaw:
    """How stresses follow from displacement gradients.

    Attributes:
        plane: "stress" or "strain" in 2D, else None.
        linear: whether the vibrations are small, so that the stress is linear about the
            equilibrium.
        deformed: whether the equilibrium is geometrically nonlinear.
        materials: all materials.
        number: (P,) number of the material of each point; None if all points have the first one.
    """

    plane: str | None
    linear: bool
    deformed: bool
    materials: tuple[Elasticity, ...]
    number: NDArray[np.int64] | None = field(default=None, compare=False)

    @classmethod
    def of(cls, scene: Scene) -> StressLaw:
        """The law of a scene."""
        spinning = scene.rotation is not None and scene.rotation.speed_rpm != 0.0
        nonlinear = scene.geometrically_nonlinear
        plane = scene.geometry.plane if scene.geometry.dimension == 2 else None
        every = (scene.material, *scene.materials)
        return cls(plane, not nonlinear, nonlinear or spinning, every)

    def at(self, number: NDArray[np.int64] | None) -> StressLaw:
        """The law at points (P,) of which the numbers of the materials are given."""
        return self if number is None else replace(self, number=number)

    def _mapped(self, strain: Array, maps: list[Array]) -> Array:
        """The products (..., k) of strains (..., d, d) with the map (d², k) of each material."""
        flat = strain.reshape(*strain.shape[:-2], -1)
        if self.number is None:
            return np.asarray(flat @ maps[0])
        return np.asarray(np.einsum("...pa,pak->...pk", flat, np.array(maps)[self.number]))

    def of_strain(self, strain: Array) -> Array:
        """Stress (..., d, d) in the plane or in space of a strain (..., d, d), Pa."""
        d = strain.shape[-1]
        basis = mandel_basis(d).reshape(-1, d * d)
        maps = [basis.T @ stiffness(each, d, self.plane) @ basis for each in self.materials]
        return self._mapped(strain, maps).reshape(strain.shape)

    def strain(self, start: Array, change: Array) -> Array:
        """Green-Lagrange strain (..., d, d).

        Args:
            start: (..., d, d) displacement gradient of the equilibrium.
            change: (..., d, d) change of the gradient from the equilibrium.
        """
        if not self.linear:
            return _green(start + change)
        start, change = self._about(start, change)
        f = np.eye(start.shape[-1]) + start
        return _green(start) + _symmetric(np.swapaxes(f, -1, -2) @ change)

    def _about(self, start: Array, change: Array) -> tuple[Array, Array]:
        """The gradients about which a linear law is linear, and the changes from there."""
        return (start, change) if self.deformed else (np.zeros_like(start), start + change)

    def deformation_gradient(self, start: Array, change: Array) -> Array:
        """F (..., d, d) that belongs to the stress; arguments as `strain`."""
        identity = np.eye(start.shape[-1])
        if not self.linear:
            return identity + start + change
        return np.broadcast_to(identity + self._about(start, change)[0], change.shape)

    def volume_ratio(self, start: Array, change: Array) -> Array:
        """The ratio det F (...), in plane stress with the thickness; arguments as `strain`."""
        volume = np.linalg.det(self.deformation_gradient(start, change))
        if self.plane == "stress" and (self.deformed or not self.linear):
            thickness = 1.0 + 2.0 * self._across(self.strain(start, change))
            volume = volume * np.sqrt(np.maximum(thickness, 0.0))
        return np.asarray(volume)

    def second_piola(self, start: Array, change: Array) -> Array:
        """Second Piola-Kirchhoff stress (..., 6), Pa; arguments as `strain`."""
        strain = self.strain(start, change)
        return components(self.of_strain(strain), self._out_of_plane(strain))

    def cauchy(self, start: Array, change: Array) -> Array:
        """Cauchy stress (..., 6), Pa; arguments as `strain`."""
        strain = self.strain(start, change)
        f = self.deformation_gradient(start, change)
        volume = self.volume_ratio(start, change)
        pushed = f @ self.of_strain(strain) @ np.swapaxes(f, -1, -2)
        return components(pushed / volume[..., None, None], self._out_of_plane(strain) / volume)

    def first_piola(self, start: Array, change: Array) -> Array:
        """First Piola-Kirchhoff stress F S (..., d, d) of the internal force, Pa."""
        if not self.linear:
            stress = self.of_strain(self.strain(start, change))
            return self.deformation_gradient(start, change) @ stress
        start, change = self._about(start, change)
        f, stress = np.eye(start.shape[-1]) + start, self.of_strain(_green(start))
        more = self.of_strain(_symmetric(np.swapaxes(f, -1, -2) @ change))
        return f @ (stress + more) + change @ stress

    def modal(self, start: Array, change: Array) -> Array:
        """Derivative (..., 6) of the second Piola-Kirchhoff stress about the equilibrium, Pa."""
        if self.deformed:
            change = np.swapaxes(np.eye(start.shape[-1]) + start, -1, -2) @ change
        strain = _symmetric(change)
        return components(self.of_strain(strain), self._out_of_plane(strain))

    def _out_of_plane(self, strain: Array) -> Array:
        """S_zz (...) of a plane body, Pa; zero in plane stress."""
        if self.plane == "strain":
            return self._across(strain)
        return np.zeros(strain.shape[:-2])

    def _across(self, strain: Array) -> Array:
        """E_zz (...) in plane stress, S_zz in plane strain, Pa."""
        basis = mandel_basis(2).reshape(3, 4)
        maps = [(across(each, self.plane) @ basis)[:, None] for each in self.materials]
        return self._mapped(strain, maps)[..., 0]


@dataclass(frozen=True, eq=False)
class StressTable:
    """The gradients of a reduced model of n coordinates at P Gauss points in d dimensions.

    The points are ordered by cells: C cells of g points and v vertices each; N vertices in all.

    Attributes:
        law: how stresses follow from them.
        position: (P, d) places in the undeformed body, m.
        volume: (P,) volume that a point stands for, m³.
        gradients: (1 + n, P, d, d) gradients of u₀ and of every φ.
        cells: (C, v) vertices of each cell, in the order of dolfinx.
        vertex_position: (N, d) places of the vertices in the undeformed body, m.
        vertex_displacement: (1 + n, N, d) displacements of u₀ (m) and of every φ at the vertices.
        extrapolation: (v, g) from the Gauss points of a cell to its vertices.
        material: (P,) number of the material of each point; None with one material.
    """

    law: StressLaw
    position: Array
    volume: Array
    gradients: Array
    cells: NDArray[np.int64]
    vertex_position: Array
    vertex_displacement: Array
    extrapolation: Array
    material: NDArray[np.int64] | None = None

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.gradients.shape[0] - 1

    @cached_property
    def recovery(self) -> csr_array:
        """(N, P) values at the vertices from values at the Gauss points."""
        from scipy.sparse import csr_array  # slow to import, and few models have stresses

        v, g = self.extrapolation.shape
        rows = np.repeat(self.cells.reshape(-1), g)
        points = np.arange(self.position.shape[0]).reshape(-1, 1, g)
        columns = np.tile(points, (1, v, 1)).ravel()
        meeting = np.bincount(self.cells.reshape(-1), minlength=self.vertex_position.shape[0])
        weights = np.tile(self.extrapolation.reshape(-1), self.cells.shape[0]) / meeting[rows]
        shape = (self.vertex_position.shape[0], self.position.shape[0])
        return csr_array((weights, (rows, columns)), shape=shape)

    def stress(self, q: Array, measure: str = SECOND_PIOLA_KIRCHHOFF) -> Array:
        """Stresses (..., P, 6) at the Gauss points, Pa.

        Args:
            q: (..., n) coordinates.
            measure: one of `MEASURES`.
        """
        change = np.asarray(np.tensordot(q, self.gradients[1:], axes=1), np.float64)
        law = self.law.at(self.material)
        if measure == CAUCHY:
            return law.cauchy(self.gradients[0], change)
        return law.second_piola(self.gradients[0], change)

    def modal_stress(self, direction: Array) -> Array:
        """Derivative (..., P, 6) of the second Piola-Kirchhoff stress at q = 0, Pa.

        Args:
            direction: (..., n) directions in the coordinates.
        """
        change = np.asarray(np.tensordot(direction, self.gradients[1:], axes=1), np.float64)
        return self.law.at(self.material).modal(self.gradients[0], change)

    def at_vertices(self, values: Array) -> Array:
        """Recover values (..., P, m) at the Gauss points to the vertices, (..., N, m)."""
        first = np.moveaxis(values, -2, 0)
        found = self.recovery @ first.reshape(first.shape[0], -1)
        return np.moveaxis(found.reshape(-1, *first.shape[1:]), 0, -2)

    def in_cells(self, values: Array) -> Array:
        """Mean values (C, m) in the cells of values (P, m) at the Gauss points, by volume."""
        g = self.extrapolation.shape[1]
        weights = self.volume.reshape(-1, g, 1)
        sums = (weights * values.reshape(-1, g, values.shape[1])).sum(axis=1)
        return np.asarray(sums / weights.sum(axis=1))

    def displacement(self, q: Array) -> Array:
        """Displacements (..., N, d) of the vertices at coordinates q (..., n), m."""
        moved = self.vertex_displacement
        return np.asarray(moved[0] + np.tensordot(q, moved[1:], axes=1))


def components(tensor: Array, across: Array) -> Array:
    """Components (..., 6) of symmetric tensors (..., d, d); `across` (...) is zz in 2D."""
    d = tensor.shape[-1]
    found = np.zeros((*tensor.shape[:-2], 6))
    for k, (i, j) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        if i < d and j < d:
            found[..., k] = tensor[..., i, j]
    if d == 2:
        found[..., 2] = across
    return found


def tensors(stress: Array) -> Array:
    """Symmetric tensors (..., 3, 3) of components (..., 6)."""
    found = np.empty((*stress.shape[:-1], 3, 3))
    found[..., ROWS, COLUMNS] = stress
    found[..., COLUMNS, ROWS] = stress
    return found


def von_mises(stress: Array) -> Array:
    """Von Mises stresses (...) of components (..., 6)."""
    normal, shear = stress[..., :3], stress[..., 3:]
    squares = 0.5 * np.sum((normal - np.roll(normal, 1, axis=-1)) ** 2, axis=-1)
    return np.asarray(np.sqrt(squares + 3.0 * np.sum(shear**2, axis=-1)))


def principal(stress: Array) -> Array:
    """Principal stresses (..., 3) of components (..., 6), the largest first."""
    return np.asarray(np.linalg.eigvalsh(tensors(stress))[..., ::-1], np.float64)


def _symmetric(gradient: Array) -> Array:
    return np.asarray(0.5 * (gradient + np.swapaxes(gradient, -1, -2)))


def _green(gradient: Array) -> Array:
    return np.asarray(_symmetric(gradient) + 0.5 * np.swapaxes(gradient, -1, -2) @ gradient)

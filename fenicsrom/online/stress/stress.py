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

Elasticity tensors of materials as matrices in Mandel's notation.

A symmetric tensor x becomes the vector of its normal components and of √2 times its shear
components, in the order (xx, yy, zz, xy, xz, yz) in space and (xx, yy, xy) in the plane. The
product x : y of two tensors is that of their vectors, so that a rotation of the tensor is an
orthogonal matrix, and the elasticity tensor a symmetric one.

The strains of all vectors and pairs of vectors at many points, compiled.

`fenicsrom.reduction.basis` multiplies these columns.

How far a body is deformed locally: the volume ratio and the principal stretches.

The volume ratio is det F of the deformation gradient F = I + ∇u. Where it is not positive, the
material is turned inside out. The St Venant-Kirchhoff law does not resist this: under uniaxial
stress along a stretch s (Poisson's ratio 0), the force on the undeformed area and its slope are

    P = ½ E s (s² − 1),    dP/ds = ½ E (3 s² − 1),    (2)

so that the material softens in compression. The slope vanishes at s = 1/√3, a compression of 42 %,
and the force returns to zero at s = 0, where the material has no volume. The principal stretches
are the square roots of the eigenvalues of FᵀF.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compilation import kernel
from fenicsrom.scene import Elasticity, Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array


IN_PLANE = [0, 1, 3]
"""Places of (xx, yy, xy) in space."""


def stiffness(material: Elasticity, dimension: int, plane: str | None) -> Array:
    """The elasticity tensor (m, m) of a material in global axes, Pa; m = 3 in 2D, 6 in 3D.

    Args:
        material: the material, with its axes.
        dimension: 2 or 3.
        plane: "stress" or "strain" in 2D.
    """
    whole = in_space(material)
    if dimension == 3:
        found = whole
    elif plane == "strain":
        found = whole[np.ix_(IN_PLANE, IN_PLANE)]
    else:
        found = np.linalg.inv(np.linalg.inv(whole)[np.ix_(IN_PLANE, IN_PLANE)])
    return np.asarray(0.5 * (found + found.T))


def across(material: Elasticity, plane: str | None) -> Array:
    """The row (3,) that gives S_zz in plane strain, or E_zz in plane stress, from the strain."""
    whole = in_space(material)
    if plane == "strain":
        return np.asarray(whole[2, IN_PLANE])
    return np.asarray(np.linalg.inv(whole)[2, IN_PLANE] @ stiffness(material, 2, plane))


def in_space(material: Elasticity) -> Array:
    """The elasticity tensor (6, 6) of a material in space, in global axes, Pa."""
    turned = rotation(axes(material))
    return np.asarray(turned @ np.linalg.inv(compliance(material)) @ turned.T)


def compliance(material: Elasticity) -> Array:
    """The compliance (6, 6) of a material in its own axes, 1/Pa.

    This is (1) of `fenicsrom.scene.keys.places`.
    """
    young, (nu12, nu13, nu23), shear = material.orthotropic_constants
    found = np.diag([*(1.0 / np.array(young)), *(0.5 / np.array(shear))])
    for i, j, nu in ((0, 1, nu12), (0, 2, nu13), (1, 2, nu23)):
        found[i, j] = found[j, i] = -nu / young[i]
    return found


def axes(material: Elasticity) -> Array:
    """The material axes as the columns of a rotation (3, 3)."""
    if material.axes is None:
        return np.eye(3)
    given = [np.array([*axis, 0.0][:3]) for axis in material.axes]
    first = given[0] / np.linalg.norm(given[0])
    if len(given) == 2:
        second = given[1]
    else:  # in 2D axis 3 is z; in 3D any direction in the plane of isotropy serves
        normal = np.eye(3)[2 if len(material.axes[0]) == 2 else np.argmin(np.abs(first))]
        second = np.cross(normal, first)
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


def rotation(turn: Array) -> Array:
    """The matrix (6, 6) that turns the vector of a symmetric tensor x into that of R x Rᵀ."""
    basis = mandel_basis(3)
    turned = turn @ basis @ turn.T
    return np.asarray(np.einsum("aij,bij->ab", basis, turned))


def mandel_basis(dimension: int) -> Array:
    """The orthonormal basis (m, d, d) of the symmetric tensors, in the order of the vectors."""
    d = dimension
    pairs = [(k, k) for k in range(d)] + [(i, j) for i in range(d) for j in range(i + 1, d)]
    found = np.zeros((len(pairs), d, d))
    for k, (i, j) in enumerate(pairs):
        found[k, i, j] = found[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return found


SHEAR = float(np.sqrt(0.5))
"""Factor of x_bc + x_cb: the shear component in Mandel's notation is √2 times that of sym x."""


@kernel
def write_strains(gradients: Array, scaled: Array, columns: Array) -> None:
    """Write E₀, ε_i and h_ij of `fenicsrom.reduction.basis`, eq. (3), at k points.

    Args:
        gradients: (d, d, 1 + n, k) displacement gradients; the first one is that of u₀.
        scaled: (d, d, 1 + n, k) these times a factor of each point.
        columns: (s, d (d + 1) / 2, k) out: the strains in Mandel's notation, times this factor.
    """
    fields = gradients.shape[2]
    write_product(gradients, 0, scaled, 0, 1.0, 0.5, columns, 0)
    for j in range(1, fields):
        write_product(gradients, 0, scaled, j, 1.0, 1.0, columns, j)
    row = fields
    for i in range(1, fields):
        for j in range(i, fields):
            write_product(gradients, i, scaled, j, 0.0, 1.0, columns, row)
            row += 1


@kernel
def write_product(
    left: Array, i: int, right: Array, j: int, own: float, weight: float, columns: Array, row: int
) -> None:
    """Write own · sym(y) + weight · sym(xᵀ y) with x = left_i and y = right_j.

    Args:
        left: (d, d, l, k).
        i: number of x.
        right: (d, d, r, k).
        j: number of y.
        own: factor of y itself.
        weight: factor of the product.
        columns: (s, d (d + 1) / 2, k) out.
        row: where to write.
    """
    d, points = left.shape[0], left.shape[3]
    shear = d
    for b in range(d):
        for p in range(points):
            columns[row, b, p] = own * right[b, b, j, p]
        for a in range(d):
            for p in range(points):
                columns[row, b, p] += weight * left[a, b, i, p] * right[a, b, j, p]
        for c in range(b + 1, d):
            for p in range(points):
                columns[row, shear, p] = SHEAR * own * (right[b, c, j, p] + right[c, b, j, p])
            for a in range(d):
                for p in range(points):
                    both = (
                        left[a, b, i, p] * right[a, c, j, p] + left[a, c, i, p] * right[a, b, j, p]
                    )
                    columns[row, shear, p] += SHEAR * weight * both
            shear += 1


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


@dataclass(frozen=True, eq=False)
class Deformation:
    """The extremes of the deformation over some points of a body.

    Attributes:
        volume_ratio: smallest det F; in plane stress with the thickness, which is 0 where the law
            gives none.
        position: (d,) its place in the undeformed body, m.
        smallest_stretch: smallest principal stretch, in the plane of a plane body.
        largest_stretch: largest principal stretch.
    """

    volume_ratio: float
    position: Array
    smallest_stretch: float
    largest_stretch: float

    @property
    def is_inverted(self) -> bool:
        """Whether the material is turned inside out somewhere."""
        return self.volume_ratio <= 0.0


NOWHERE = Deformation(np.inf, np.zeros(0), np.inf, 0.0)
"""The extremes over no points."""


def deformation(law: StressLaw, position: Array, start: Array, change: Array) -> Deformation:
    """The extremes over points (P,).

    Args:
        law: the law at these points.
        position: (P, d) their places, m.
        start: (P, d, d) displacement gradient of the equilibrium.
        change: (P, d, d) change of the gradient from the equilibrium.
    """
    if not position.shape[0]:
        return NOWHERE
    volume = law.volume_ratio(start, change)
    f = law.deformation_gradient(start, change)
    squares = np.linalg.eigvalsh(np.swapaxes(f, -1, -2) @ f)
    first = int(np.argmin(volume))
    smallest, largest = (float(np.sqrt(max(x, 0.0))) for x in (squares.min(), squares.max()))
    return Deformation(float(volume[first]), position[first], smallest, largest)


def extremes(parts: Sequence[Deformation]) -> Deformation:
    """The extremes over several sets of points."""
    first = min(parts, key=lambda part: part.volume_ratio)
    smallest = min(part.smallest_stretch for part in parts)
    largest = max(part.largest_stretch for part in parts)
    return replace(first, smallest_stretch=smallest, largest_stretch=largest)


def deformation_at(table: StressTable, q: Array) -> Deformation:
    """The extremes at the Gauss points of a table at coordinates q (n,)."""
    change = np.asarray(np.tensordot(q, table.gradients[1:], axes=1), np.float64)
    law = table.law.at(table.material)
    return deformation(law, table.position, table.gradients[0], change)

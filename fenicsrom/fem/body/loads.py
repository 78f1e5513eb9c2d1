"""Load vectors of all loads, and the follower pressures.

A follower pressure acts on the current area of facets, along their current normal.

With the deformation gradient F = I + ∇u, the outer normal N and the area dA of the undeformed body,
the current area is n da = cof(F) N dA (Nanson's formula). A pressure of size 1 gives the force g,
its tangent T and the derivative B of the tangent,

    v · g(u) = −∫ cof(F) N · v dA,    cof(F) N = N₁ F₂ × F₃ + N₂ F₃ × F₁ + N₃ F₁ × F₂,    (1)
    T(u) w   = ∂g/∂u w,    (2)
    B[x] w   = ∂T/∂u [x] w,    (3)

with the columns Fᵢ. In 2D, cof(F) is linear in F and B is zero. The quadrature is exact, so T is
symmetric up to an integral over the edge of the surface. T is symmetric if the edge is clamped, if
the surface is closed, or if the displacement of the edge is held in the planes of symmetry.
Otherwise the pressure has no potential: see Schweizerhof and Ramm, Displacement dependent pressure
loads in nonlinear finite element analyses, Computers & Structures 18, 1984.

The equations of the body have F₀ = −Σ p g(u) of the static pressures on the side of the internal
force. Time-dependent pressures act in a motion only.
"""

from collections.abc import Sequence
from typing import Any

import dolfinx.fem.petsc
import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.base.linalg import multiply
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.fem.body.places import Places
from fenicsrom.online.model.loads import PressurePolynomial, no_pressure
from fenicsrom.scene import Load, Region
from fenicsrom.scene.base.rules import Where

LOAD_DEGREE = 6
"""Degree of the quadrature rule on loaded facets.

It is exact for tractions and pressures on quadratic cells with straight edges. It is also exact for
pressures on curved cells: the normal times the area of a curved quadratic quadrilateral is a cubic
in each direction.
"""


def load_vector(body: ElasticBody, places: Places, load: Load, key: str) -> Array:
    """Assemble the load vector of a load of size 1. Collective.

    On the undeformed body, a traction t does the work ∫ t · v dA, a pressure p the work
    −∫ p n · v dA, an acceleration a the work ∫ ρ a · v dV, and an acceleration of the supports the
    opposite work; in 2D each is multiplied by the thickness. The vector includes the clamped
    unknowns, except for a point force.

    Args:
        body: the body.
        places: its places.
        load: the load.
        key: key of the load in the scene, for messages.

    Returns:
        (local,) load vector.

    Raises:
        SceneError: as `Places.find`; or a pressure acts on facets inside the body.
    """
    if load.kind == "force":
        return np.array(load.direction) @ places.find(load.place, key)[0]
    test = ufl.TestFunction(body.space)
    if load.everywhere:
        direction = body.constant(load.direction)
        spread = body.assembled(compiled_form(body.density * ufl.dot(direction, test) * body.dx))
        spread += body.point_masses * np.tile(load.direction, body.local // body.dimension)
        return -spread if load.moves_supports else spread
    if load.kind == "traction":
        return _surface_vector(body, load.place, body.constant(load.direction))
    check_on_boundary(body, load, key)
    return pressure_vector(body, load.place)


def pressure_vector(body: ElasticBody, place: Region) -> Array:
    """The load vector (local,) of a pressure of 1 Pa on facets, with the clamped unknowns."""
    return -_surface_vector(body, place, ufl.FacetNormal(body.mesh.domain))


def _surface_vector(body: ElasticBody, place: Region, traction: Any) -> Array:
    """The load vector (local,) of a traction on facets, a UFL vector, Pa."""
    surface = body.mesh.surface(place).reconstruct(metadata={"quadrature_degree": LOAD_DEGREE})
    work = ufl.dot(traction, ufl.TestFunction(body.space))
    return body.assembled(compiled_form(body.thickness * work * surface))


def check_on_boundary(body: ElasticBody, load: Load, key: str) -> None:
    """Check that a pressure acts on the boundary. Collective.

    Raises:
        SceneError: a facet lies inside the body.
    """
    if body.mesh.reaches_inside(load.place):
        where = Where(body.source, f"{key}.pressure")
        allowed = "must act on the boundary, but some of these facets lie inside the body"
        raise where.refuse(load.size, allowed, ErrorKind.PLACE)


def _area(f: Any, normal: Any) -> Any:
    """cof(F) N."""
    if len(normal) == 2:
        return ufl.as_vector(
            [f[1, 1] * normal[0] - f[1, 0] * normal[1], f[0, 0] * normal[1] - f[0, 1] * normal[0]]
        )
    columns = [ufl.as_vector([f[i, k] for i in range(3)]) for k in range(3)]
    return sum(normal[i] * ufl.cross(columns[(i + 1) % 3], columns[(i + 2) % 3]) for i in range(3))


class _Surface:
    """The forms (1) to (3) of one pressure.

    Attributes:
        force: (1).
        tangent: (2).
        symmetric: the symmetric part of (2).
        bend: (3), or None in 2D.
    """

    def __init__(self, body: Any, surface: ufl.Measure, u: Any, x: Any):
        trial, test = ufl.TrialFunction(body.space), ufl.TestFunction(body.space)
        facet, d = ufl.FacetNormal(body.mesh.domain), body.dimension
        self.weight = body.constant(1.0)
        area = _area(ufl.Identity(d) + ufl.grad(u), [facet[k] for k in range(d)])
        force = -self.weight * body.thickness * ufl.dot(area, test) * surface
        tangent = ufl.derivative(force, u, trial)
        self.force, self.tangent = compiled_form(force), compiled_form(tangent)
        self.symmetric = compiled_form(0.5 * (tangent + ufl.adjoint(tangent)))
        self.bend = compiled_form(ufl.derivative(tangent, u, x)) if d == 3 else None


class FollowerPressures:
    """The follower pressures of a body.

    Attributes:
        numbers: (k,) the numbers of the pressures among the loads.
        static: (k,) sizes of the static pressures, Pa; zero for those that vary in time.
        part: the part of the static pressures that acts; load steps vary it.
    """

    def __init__(self, body: Any, loads: Sequence[Load]):
        """Compile the forms.

        Args:
            body: the body.
            loads: all loads of the scene.

        Raises:
            SceneError: a pressure acts on facets that the mesh lacks, or inside the body.
        """
        self._body = body
        self.numbers = np.array([k for k, load in enumerate(loads) if load.follower], np.int64)
        mine = [loads[k] for k in self.numbers]
        self.static = np.array([load.size if load.static else 0.0 for load in mine])
        self.part = 1.0
        self._u, self._x = fem.Function(body.space), fem.Function(body.space)
        self._surfaces = []
        for k, load in zip(self.numbers, mine, strict=True):
            measure = body.mesh.surface(load.place)
            check_on_boundary(body, load, f"loads[{k}]")
            surface = measure.reconstruct(metadata={"quadrature_degree": LOAD_DEGREE})
            self._surfaces.append(_Surface(body, surface, self._u, self._x))

    @property
    def acts(self) -> bool:
        """Whether static pressures act on the body."""
        return bool(np.any(self.static))

    def unit_forces(self, u: Array) -> Array:
        """The forces (1) of all pressures at a displacement u (local,): (local, k), N per Pa."""
        self._body.set_field(self._u, u)
        found = np.zeros((self._body.local, len(self._surfaces)))
        for k, surface in enumerate(self._surfaces):
            found[:, k] = self._body.assembled(surface.force)
        return self._body.without_held(found)

    def static_force(self, u: Array) -> Array:
        """The force (local,) of the part of the static pressures at u (local,), N."""
        return self.part * (self.unit_forces(u) @ self.static)

    def add_tangent(
        self, matrix: PETSc.Mat, u: Array, factors: Array, *, symmetric: bool = False
    ) -> None:
        """Subtract the tangents (2) times factors (k,) from an assembled stiffness matrix.

        Args:
            matrix: the matrix, which stays regular on the clamped rows.
            u: (local,) displacement, m.
            factors: (k,) Pa.
            symmetric: whether to take the symmetric part of the tangents.
        """
        self._body.set_field(self._u, u)
        for factor, surface in zip(factors, self._surfaces, strict=True):
            if factor == 0.0:
                continue
            surface.weight.value = -factor
            form = surface.symmetric if symmetric else surface.tangent
            self._body.add_form(matrix, form)
            surface.weight.value = 1.0

    def tangent_times(
        self, u: Array, block: Array, factors: Array, *, symmetric: bool = False
    ) -> Array:
        """The tangents (2) at u (local,), times factors (k,), times a block (local, m).

        `symmetric` takes their symmetric parts.
        """
        self._body.set_field(self._u, u)
        found = np.zeros_like(block)
        for factor, surface in zip(factors, self._surfaces, strict=True):
            if factor != 0.0:
                form = surface.symmetric if symmetric else surface.tangent
                found += factor * self._product(form, block)
        return found

    def static_derivative(self, x: Array, y: Array) -> Array:
        """B[x] y of (3), times the sizes of the static pressures, for x and y (local,)."""
        self._body.set_field(self._x, x)
        found = np.zeros_like(x)
        for factor, surface in zip(self.static, self._surfaces, strict=True):
            if factor != 0.0 and surface.bend is not None:
                found += factor * self._product(surface.bend, y[:, None])[:, 0]
        return found

    def polynomial(self, u0: Array, vectors: Array) -> PressurePolynomial:
        """Project (2) at u₀ (local,) and (3) on vectors (local, n): exact coefficients."""
        body, n = self._body, vectors.shape[1]
        if not self._surfaces:
            return no_pressure(n)
        depth = n if body.dimension == 3 else 0
        linear = np.zeros((self.numbers.size, n, n))
        quadratic = np.zeros((self.numbers.size, depth, n, n))
        body.set_field(self._u, u0)
        for k, surface in enumerate(self._surfaces):
            linear[k] = body.inner(vectors, self._product(surface.tangent, vectors))
            for c in range(depth):
                body.set_field(self._x, vectors[:, c])
                assert surface.bend is not None
                quadratic[k, c] = body.inner(vectors, self._product(surface.bend, vectors))
        return PressurePolynomial(self.numbers, linear, quadratic)

    def _product(self, form: fem.Form, block: Array) -> Array:
        """A bilinear form, zero on the clamped rows, times a block (local, m). Collective."""
        matrix = dolfinx.fem.petsc.create_matrix(form)  # only the cells of the surface have entries
        dolfinx.fem.petsc.assemble_matrix(matrix, form)
        matrix.assemble()
        found = np.asarray(multiply(matrix, block))
        matrix.destroy()
        return self._body.without_held(found)

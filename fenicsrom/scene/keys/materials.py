"""Materials of the body and of groups of cells: isotropic, transversely isotropic or orthotropic.

An orthotropic material has three axes. With Young's moduli E₁, E₂, E₃ along them, Poisson's ratios
ν_ij (contraction along j under a stress along i) and shear moduli G_ij, the strains follow from the
stresses by the compliance

    ε_i = σ_i / E_i − Σ_{j≠i} ν_ji σ_j / E_j,    ν_ji / E_j = ν_ij / E_i,    γ_ij = σ_ij / G_ij. (1)

A transversely isotropic material has E₂ = E₃, ν₁₂ = ν₁₃, G₁₂ = G₁₃ and G₂₃ = E₂ / (2 (1 + ν₂₃)).
Source: Jones, Mechanics of Composite Materials, 1999, section 2.3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass
from typing import Annotated, Any

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import Rule, Where, is_sequence, number

Moduli = tuple[float, ...]


def _number_or_list(one: Rule, entry: Rule, least: int) -> Rule:
    """Make the rule of a number, or of a list of `least` to 3 numbers."""
    count = "3 numbers" if least == 3 else f"{least} or 3 numbers"

    def read(value: Any, where: Where) -> float | Moduli:
        if not is_sequence(value):
            return float(one(value, where))
        if not least <= len(value) <= 3:
            raise where.refuse(value, f"must be a number or a list of {count}")
        return tuple(entry(item, where.at(index)) for index, item in enumerate(value))

    several = {"type": "array", "items": entry.schema, "minItems": least, "maxItems": 3}
    schema = {"oneOf": [one.schema, several]}
    return Rule(read, schema, f"{one.allowed} or list of {count}", one.unit)


def _read_axes(value: Any, where: Where) -> tuple[Moduli, ...]:
    if not is_sequence(value) or len(value) not in (1, 2):
        raise where.refuse(value, "must be a list of one or two vectors", ErrorKind.TYPE)
    return tuple(rules.direction(axis, where.at(index)) for index, axis in enumerate(value))


AXES_RULE = Rule(
    _read_axes,
    {"type": "array", "items": rules.direction.schema, "minItems": 1, "maxItems": 2},
    "list of one or two vectors",
)


@dataclass(frozen=True, kw_only=True)
class Elasticity:
    """The elastic constants and the density of a material.

    Attributes:
        young: Young's modulus; [E1, E2] of a transversely isotropic material, whose plane of
            isotropy is normal to axis 1; [E1, E2, E3] of an orthotropic one.
        poisson: Poisson's ratio; [nu12, nu23] with two Young's moduli, [nu12, nu13, nu23] with
            three. nu12 is the contraction along axis 2 under a stress along axis 1.
        shear: shear modulus G12 with two Young's moduli, [G12, G13, G23] with three; not for an
            isotropic material.
        axes: axis 1 of a material that is not isotropic and, in 3D, a vector in the plane of the
            axes 1 and 2; by default x and y.
        density: density.
    """

    young: Annotated[
        float | Moduli, _number_or_list(number(above=0.0, unit="Pa"), number(above=0.0), 2)
    ]
    poisson: Annotated[float | Moduli, _number_or_list(number(least=0.0, below=0.5), number(), 2)]
    shear: Annotated[
        float | Moduli | None, _number_or_list(number(above=0.0, unit="Pa"), number(above=0.0), 3)
    ] = None
    axes: Annotated[tuple[Moduli, ...] | None, AXES_RULE] = None
    density: Annotated[float, number(above=0.0, unit="kg/m³")]

    @property
    def is_isotropic(self) -> bool:
        """Whether the material has one Young's modulus."""
        return not isinstance(self.young, tuple)

    @property
    def isotropic_constants(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio of an isotropic material."""
        assert isinstance(self.young, float) and isinstance(self.poisson, float)
        return self.young, self.poisson

    @property
    def orthotropic_constants(self) -> tuple[Moduli, Moduli, Moduli]:
        """(E₁, E₂, E₃) in Pa, (ν₁₂, ν₁₃, ν₂₃) and (G₁₂, G₁₃, G₂₃) in Pa of any material."""
        young, poisson, shear = self.young, self.poisson, self.shear
        if not isinstance(young, tuple):
            e, nu = self.isotropic_constants
            return (e,) * 3, (nu,) * 3, (e / (2.0 * (1.0 + nu)),) * 3
        assert isinstance(poisson, tuple)
        if len(young) == 2:
            (e1, e2), (nu12, nu23) = young, poisson
            assert isinstance(shear, float)
            across = e2 / (2.0 * (1.0 + nu23))
            return (e1, e2, e2), (nu12, nu12, nu23), (shear, shear, across)
        assert isinstance(shear, tuple)
        return young, poisson, shear


@dataclass(frozen=True, kw_only=True)
class Material(Elasticity):
    """A St Venant–Kirchhoff material with mass-proportional damping C = α M.

    Attributes:
        mass_damping: factor α of the damping matrix C = α M.
    """

    mass_damping: Annotated[float, number(least=0.0, unit="1/s")] = 0.0


@dataclass(frozen=True, kw_only=True)
class GroupMaterial(Elasticity):
    """The material of a group of cells, in place of [material].

    Attributes:
        group: name of a group of cells.
        thickness: thickness of the group, in 2D only; by default that of [geometry].
    """

    group: Annotated[str, rules.name]
    thickness: Annotated[float | None, number(above=0.0, unit="m")] = None


Found = Iterator[tuple[str, object, str, ErrorKind]]


def constant_problems(material: Material, groups: Sequence[GroupMaterial], dimension: int) -> Found:
    """Yield (key, value, allowed, kind) of the materials that are not allowed."""
    yield from _problems_of_one(material, "material", dimension)
    for index, group in enumerate(groups):
        key = f"materials[{index}]"
        yield from _problems_of_one(group, key, dimension)
        if group.group in [other.group for other in groups[:index]]:
            yield f"{key}.group", group.group, "must occur only once", ErrorKind.CONFLICT
        if dimension == 3 and group.thickness is not None:
            yield f"{key}.thickness", group.thickness, "only allowed in 2D", ErrorKind.CONFLICT


def _problems_of_one(material: Elasticity, key: str, dimension: int) -> Found:
    """Yield the problems of the constants and axes of one material."""
    conflict = ErrorKind.CONFLICT
    if material.is_isotropic:
        if isinstance(material.poisson, tuple):
            allowed = "must be a number with one Young's modulus"
            yield f"{key}.poisson", list(material.poisson), allowed, conflict
        for name in ("shear", "axes"):
            if (value := getattr(material, name)) is not None:
                yield f"{key}.{name}", value, "not allowed with one Young's modulus", conflict
        return
    assert isinstance(material.young, tuple)
    count = len(material.young)
    words = {2: "two", 3: "three"}[count]
    if not isinstance(material.poisson, tuple) or len(material.poisson) != count:
        names = {2: "[nu12, nu23]", 3: "[nu12, nu13, nu23]"}[count]
        allowed = f"must be {names} with {words} Young's moduli"
        yield f"{key}.poisson", material.poisson, allowed, conflict
    elif material.shear is None or isinstance(material.shear, tuple) != (count == 3):
        names = {2: "the number G12", 3: "[G12, G13, G23]"}[count]
        value = MISSING if material.shear is None else material.shear
        yield f"{key}.shear", value, f"must be {names} with {words} Young's moduli", conflict
    elif not _is_positive_definite(material):
        allowed = (
            "the elastic energy must be positive for every strain: |nu12| < sqrt(E1 / E2) and so "
            "on, and the determinant of the compliance must be positive"
        )
        yield f"{key}.poisson", list(material.poisson), allowed, ErrorKind.RANGE
    yield from _axes_problems(material.axes or (), f"{key}.axes", count, dimension)


def _axes_problems(axes: tuple[Moduli, ...], key: str, count: int, dimension: int) -> Found:
    """Yield the problems of the axes of a material with `count` Young's moduli."""
    conflict = ErrorKind.CONFLICT
    for index, axis in enumerate(axes):
        if len(axis) != dimension:
            allowed = f"must have {dimension} components with geometry.dimension = {dimension}"
            yield f"{key}[{index}]", list(axis), allowed, conflict
            return
    if dimension == 2 and len(axes) == 2:
        yield key, axes, "must be one vector in 2D", conflict
    if dimension == 3 and count == 3 and len(axes) == 1:
        yield key, axes, "must be two vectors with three Young's moduli in 3D", conflict
    if len(axes) == 2 and abs(sum(a * b for a, b in zip(*axes, strict=True))) > PARALLEL:
        yield key, axes, "the two vectors must not be parallel", ErrorKind.RANGE


PARALLEL = 1.0 - 1e-6
"""Larger cosines of the angle between two axes count as parallel: the angle is 0.08 degrees."""


def _is_positive_definite(material: Elasticity) -> bool:
    """Whether the compliance (1) is positive definite: its leading minors are positive."""
    (e1, e2, e3), (nu12, nu13, nu23), _ = material.orthotropic_constants
    a, b, c = nu12 * math.sqrt(e2 / e1), nu13 * math.sqrt(e3 / e1), nu23 * math.sqrt(e3 / e2)
    return max(abs(a), abs(b), abs(c)) < 1.0 and 1.0 - a * a - b * b - c * c - 2.0 * a * b * c > 0.0

"""Checks of the elastic constants and the axes of materials (`fenicsrom.scene.keys.materials`)."""

from __future__ import annotations

import math

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base.rules import Problem, Problems
from fenicsrom.scene.keys.materials import Elasticity
from fenicsrom.scene.keys.schema import Scene

PARALLEL = 1.0 - 1e-6
"""Larger cosines of the angle between two axes count as parallel: the angle is 0.08 degrees."""

WORDS = {
    2: ("two Young's moduli", "[nu12, nu23]", "the number G12"),
    3: ("three Young's moduli", "[nu12, nu13, nu23]", "[G12, G13, G23]"),
}
"""Names of the constants by the number of Young's moduli."""


def material_problems(scene: Scene) -> Problems:
    """Yield the problems of the materials."""
    dimension = scene.geometry.dimension
    yield from _problems_of_one(scene.material, "material", dimension)
    for index, group in enumerate(scene.materials):
        key = f"materials[{index}]"
        yield from _problems_of_one(group, key, dimension)
        if group.group in [other.group for other in scene.materials[:index]]:
            yield Problem(f"{key}.group", "must occur only once")
        if dimension == 3 and group.thickness is not None:
            yield Problem(f"{key}.thickness", "only allowed in 2D")


def _problems_of_one(material: Elasticity, key: str, dimension: int) -> Problems:
    """Yield the problems of the constants and axes of one material."""
    poisson, shear = material.poisson, material.shear
    if not isinstance(material.young, tuple):
        if isinstance(poisson, tuple):
            yield Problem(f"{key}.poisson", "must be a number with one Young's modulus")
        for name in ("shear", "axes"):
            if getattr(material, name) is not None:
                yield Problem(f"{key}.{name}", "not allowed with one Young's modulus")
        return
    count = len(material.young)
    moduli, ratios, shears = WORDS[count]
    if not isinstance(poisson, tuple) or len(poisson) != count:
        yield Problem(f"{key}.poisson", f"must be {ratios} with {moduli}")
    elif shear is None or isinstance(shear, tuple) != (count == 3):
        yield Problem(f"{key}.shear", f"must be {shears} with {moduli}")
    elif not _is_positive_definite(material):
        allowed = (
            "the elastic energy must be positive for every strain: |nu12| < sqrt(E1 / E2) and so "
            "on, and the determinant of the compliance must be positive"
        )
        yield Problem(f"{key}.poisson", allowed, ErrorKind.RANGE)
    axes, key = material.axes or (), f"{key}.axes"
    if dimension == 2 and len(axes) == 2:
        yield Problem(key, "must be one vector in 2D")
    if dimension == 3 and count == 3 and len(axes) == 1:
        yield Problem(key, "must be two vectors with three Young's moduli in 3D")
    if len(axes) == 2 and abs(sum(a * b for a, b in zip(*axes, strict=True))) > PARALLEL:
        yield Problem(key, "the two vectors must not be parallel", ErrorKind.RANGE)


def _is_positive_definite(material: Elasticity) -> bool:
    """Whether the compliance is positive definite: its leading minors are positive."""
    (e1, e2, e3), (nu12, nu13, nu23), _ = material.orthotropic_constants
    a, b, c = nu12 * math.sqrt(e2 / e1), nu13 * math.sqrt(e3 / e1), nu23 * math.sqrt(e3 / e2)
    return max(abs(a), abs(b), abs(c)) < 1.0 and 1.0 - a * a - b * b - c * c - 2.0 * a * b * c > 0.0

"""Places and materials of the solid, what holds it, and how a CAD file is meshed.

An orthotropic material has three axes. With Young's moduli E₁, E₂, E₃ along them, Poisson's ratios
ν_ij (contraction along j under a stress along i) and shear moduli G_ij, the strains follow from the
stresses by the compliance

    ε_i = σ_i / E_i − Σ_{j≠i} ν_ji σ_j / E_j,    ν_ji / E_j = ν_ij / E_i,    γ_ij = σ_ij / G_ij. (1)

A transversely isotropic material has E₂ = E₃, ν₁₂ = ν₁₃, G₁₂ = G₁₃ and G₂₃ = E₂ / (2 (1 + ν₂₃)).
Source: Jones, Mechanics of Composite Materials, 1999, section 2.3.
"""

from dataclasses import dataclass, field
from typing import Annotated

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import Rule, choice, either, integer, list_of, number
from fenicsrom.scene.base.tables import table_of, tables_of

AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A plane that picks facets.

    Attributes:
        point: a point of the plane.
        normal: normal of the plane, of any length.
        tolerance: distance at which a point still counts as a point of the plane. Default: 1e-6 of
            the extent of the mesh.
    """

    point: Annotated[tuple[float, ...], rules.point]
    normal: Annotated[tuple[float, ...], rules.direction]
    tolerance: Annotated[float | None, number(above=0.0, unit="m")] = None


@dataclass(frozen=True, kw_only=True)
class Region:
    """A part of the solid, given by a name or by coordinates; all fields except one are None.

    Attributes:
        group: name of a group of facets or nodes.
        box: opposite corners; picks the boundary facets whose vertices all lie in the box.
        plane: picks the boundary facets whose vertices all lie on a plane.
    """

    group: Annotated[str | None, rules.name] = None
    box: Annotated[tuple[tuple[float, ...], tuple[float, ...]] | None, rules.box] = None
    plane: Annotated[Plane | None, table_of(Plane)] = None


@dataclass(frozen=True, kw_only=True)
class Place(Region):
    """A point of the solid: on a region, or a node; exactly one of these keys is given.

    Attributes:
        node: coordinates of a node, which must exist.
        nearest: a point; picks the nearest node at any distance.
        at: the point of a region: its mean displacement ("mean"), the node nearest to its centroid
            ("centre"), or, for a contact, every node ("nodes").
    """

    node: Annotated[tuple[float, ...] | None, rules.point] = None
    nearest: Annotated[tuple[float, ...] | None, rules.point] = None
    at: Annotated[str, choice("mean", "centre", "nodes")] = "mean"

    @property
    def is_mean(self) -> bool:
        """Whether the place is the mean of a region, and not one of its nodes or all of them."""
        return self.node is None and self.nearest is None and self.at == "mean"


@dataclass(frozen=True, kw_only=True)
class Support(Region):
    """A region or a node on which the displacement, or a part of it, is clamped.

    Attributes:
        node: coordinates of a node, which must exist.
        components: clamped components, such as ["y"] for a roller or a plane of symmetry. Default:
            all.
        normal: the only clamped direction: a slanted roller or plane of symmetry. Not with
            components.
    """

    node: Annotated[tuple[float, ...] | None, rules.point] = None
    components: Annotated[tuple[str, ...] | None, list_of(choice(*AXES))] = None
    normal: Annotated[tuple[float, ...] | None, rules.direction] = None


@dataclass(frozen=True, kw_only=True)
class Attachment:
    """One or more of a mass, a spring and a dashpot to the ground, at a node or over a region.

    Over a region, each node gets a part in proportion to its share of the area. A spring acts with
    the force −k u, and a dashpot with the force −c u̇. With `to`, u is the mean displacement of the
    place relative to that of the other one.

    Attributes:
        place: the node or the region.
        to: another place of the body, which spring and dashpot connect with this one.
        components: directions in which spring and dashpot act, such as ["z"]. Default: all; with
            `to`, the line between the two places, as it lies in the undeformed body, unless they
            coincide.
        mass: mass.
        stiffness: stiffness k of the spring, in each direction.
        stiffness_per_area: stiffness of the spring per area; N/m² on curves in 3D, N/m for each
            node of a node set.
        damping: coefficient c of the dashpot, in each direction. Modes and Campbell diagrams leave
            it out.
        damping_per_area: coefficient of the dashpot per area; N s/m² on curves in 3D, N s/m for
            each node of a node set.
    """

    place: Annotated[Place, Place]
    to: Annotated[Place | None, table_of(Place)] = None
    components: Annotated[tuple[str, ...] | None, list_of(choice(*AXES))] = None
    mass: Annotated[float, number(least=0.0, unit="kg")] = 0.0
    stiffness: Annotated[float, number(least=0.0, unit="N/m")] = 0.0
    stiffness_per_area: Annotated[float, number(least=0.0, unit="N/m³")] = 0.0
    damping: Annotated[float, number(least=0.0, unit="N s/m")] = 0.0
    damping_per_area: Annotated[float, number(least=0.0, unit="N s/m³")] = 0.0

    @property
    def viscous(self) -> bool:
        """Whether there is a dashpot."""
        return self.damping > 0.0 or self.damping_per_area > 0.0


Moduli = tuple[float, ...]
_MODULUS = number(above=0.0, unit="Pa")


def _each(rule: Rule, entry: Rule, least: int) -> Rule:
    """Make the rule of a number, or of a list of `least` to 3 numbers."""
    return either(rule, list_of(entry, least, 3, distinct=False))


@dataclass(frozen=True, kw_only=True)
class Elasticity:
    """The elastic constants and the density of a material.

    Attributes:
        young: Young's modulus. [E1, E2] is transversely isotropic about axis 1, [E1, E2, E3]
            orthotropic.
        poisson: Poisson's ratio; [nu12, nu23] with two moduli, [nu12, nu13, nu23] with three. nu12
            is the contraction along axis 2 under a stress along axis 1.
        shear: shear modulus G12 with two Young's moduli, [G12, G13, G23] with three.
        axes: axis 1 and, in 3D, a vector in the plane of axes 1 and 2. Default: x and y.
        density: density.
    """

    young: Annotated[float | Moduli, _each(_MODULUS, _MODULUS, 2)]
    poisson: Annotated[float | Moduli, _each(number(least=0.0, below=0.5), number(), 2)]
    shear: Annotated[float | Moduli | None, _each(_MODULUS, _MODULUS, 3)] = None
    axes: Annotated[tuple[Moduli, ...] | None, list_of(rules.direction, 1, 2, distinct=False)] = (
        None
    )
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
        thickness: thickness in 2D. Default: that of [geometry].
    """

    group: Annotated[str, rules.name]
    thickness: Annotated[float | None, number(above=0.0, unit="m")] = None


MOST_MODES = 1000
_RATIO = number(least=0.0, below=1.0)
_RATIOS = either(_RATIO, list_of(_RATIO, 0, MOST_MODES, distinct=False))


@dataclass(frozen=True, kw_only=True)
class Damping:
    """Viscous damping besides the mass-proportional damping of [material].

    The damping matrix is C = α M + β K + Σ 2 ζ_k ω_k M φ_k φ_kᵀ M, where K is the stiffness at the
    equilibrium and ω_k, φ_k are the normal modes there without contact, mass-normalised. A model
    for a range of speeds has the C of `rotation.speed_rpm` at all speeds.

    Attributes:
        stiffness: factor β of the stiffness of strains and springs.
        ratios: damping ratios ζ_k of the first normal modes (of each nodal diameter), or one for
            all.
        modes: number of modes with one ratio.
    """

    stiffness: Annotated[float, number(least=0.0, unit="s")] = 0.0
    ratios: Annotated[float | tuple[float, ...], _RATIOS] = ()
    modes: Annotated[int, integer(1, MOST_MODES)] = 10

    @property
    def modal(self) -> tuple[float, ...]:
        """The damping ratio of each damped mode."""
        if isinstance(self.ratios, tuple):
            return self.ratios
        return (self.ratios,) * self.modes

    @property
    def viscous(self) -> bool:
        """Whether anything is damped."""
        return self.stiffness > 0.0 or any(self.modal)


@dataclass(frozen=True, kw_only=True)
class Refinement:
    """A face near which the cells are smaller.

    Attributes:
        group: name of the face.
        size: cell size on the face. Default: half of that of the body.
        origin: key of the support or contact from which a default follows, for messages.
    """

    group: Annotated[str, rules.name]
    size: Annotated[float | None, number(above=0.0, unit="m")] = None
    origin: str = field(default="", compare=False)


@dataclass(frozen=True, kw_only=True)
class Meshing:
    """The sizes of the cells of a .step file, besides `geometry.size`.

    Attributes:
        curvature: cells along a full circle on curved faces and edges; 0 for none.
        smallest: smallest size by curvature. Default: a twentieth of `geometry.size`.
        growth: ratio of neighbouring cell sizes.
        near: faces with smaller cells. Default: named faces of supports and contacts.
    """

    curvature: Annotated[float, number(least=0.0, most=1000.0)] = 8.0
    smallest: Annotated[float | None, number(above=0.0, unit="m")] = None
    growth: Annotated[float, number(above=1.0, most=10.0)] = 1.5
    near: Annotated[tuple[Refinement, ...] | None, tables_of(Refinement)] = None

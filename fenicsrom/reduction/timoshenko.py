"""A geometrically exact planar Timoshenko beam, clamped at x = 0: the 1D reference.

This is Reissner's beam (J. Appl. Math. Phys. 23, 1972) in a total-Lagrangian description, with
elements of two nodes. A section has the displacements u along the beam and w across it, and the
rotation θ. The strains are exact for any displacement and rotation,

    ε = (1 + u′) cos θ + w′ sin θ − 1,    γ = w′ cos θ − (1 + u′) sin θ,    κ = θ′,    (1)

and the elastic energy is

    Π = ½ ∫ (EA ε² + κ_s GA γ² + EI κ²) dx.    (2)

The shape functions are linear, with one integration point per element: this is exact for bending,
and free of the locking of ε and γ under full integration. Linear shape functions leave out the
bending of an element between two nodes that do not rotate. The compliance of this bending is added
to the compliance of shear (MacNeal's residual bending flexibility, Comput. Struct. 8, 1978): with
the length l of an element,

    1 / S = 1 / (κ_s GA) + l² / (12 EI),    (3)

and S replaces κ_s GA. Linear statics is then exact at the nodes for forces and moments at nodes,
for any number of elements. The mass matrix is consistent, integrated exactly, includes rotary
inertia, and is constant.
"""

import numpy as np
from numba import njit

from fenicsrom.arrays import Array
from fenicsrom.scene import BeamSection, Material
from fenicsrom.scene.base.rules import Where

SHEAR_CORRECTION = 5.0 / 6.0
"""κ_s of a rectangular section, from the energy of the parabolic shear stress."""

UNKNOWNS = 3
"""Unknowns per node: u, w, θ."""


@njit(cache=True)
def _assemble(
    q: Array, length: float, axial: float, shear: float, bending: float
) -> tuple[float, Array, Array]:
    """Energy (2), its gradient and its Hessian, for a beam without supports.

    The numbers (u′, w′, θ, κ) at the midpoint of an element of length l are linear in its six
    unknowns: u′ = (u₂ − u₁)/l, θ = (θ₁ + θ₂)/2. The derivatives of ε and γ with respect to
    (u′, w′, θ) are

        ∂ε = (cos θ, sin θ, γ),    ∂γ = (−sin θ, cos θ, −(1 + ε)).

    Args:
        q: unknowns (3 (elements + 1),), node after node, in m, m, rad.
        length: length of one element, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².

    Returns:
        Energy in J, force (as `q`) in N, N, N m, and the symmetric tangent.
    """
    # One long function, because energy, gradient and Hessian share every quantity of the element.
    n = q.size
    energy = 0.0
    force = np.zeros(n)
    tangent = np.zeros((n, n))
    for e in range(n // 3 - 1):
        i, j = 3 * e, 3 * e + 3
        lengthening = (q[j] - q[i]) / length
        slope = (q[j + 1] - q[i + 1]) / length
        rotation = 0.5 * (q[i + 2] + q[j + 2])
        curvature = (q[j + 2] - q[i + 2]) / length
        c, s = np.cos(rotation), np.sin(rotation)
        # ε without the difference (1 + ε) - 1, which would lose digits
        strain = lengthening * c + slope * s - 2.0 * np.sin(0.5 * rotation) ** 2
        along = 1.0 + strain
        across = slope * c - (1.0 + lengthening) * s  # γ

        normal = axial * strain
        transverse = shear * across
        moment = bending * curvature
        energy += 0.5 * length * (normal * strain + transverse * across + moment * curvature)

        # gradient and Hessian of the energy density with respect to x = u', y = w', t = θ
        f_x = normal * c - transverse * s
        f_y = normal * s + transverse * c
        f_t = normal * across - transverse * along
        k_xx = axial * c * c + shear * s * s
        k_xy = (axial - shear) * c * s
        k_yy = axial * s * s + shear * c * c
        k_xt = axial * c * across + shear * s * along - f_y
        k_yt = axial * s * across - shear * c * along + f_x
        k_tt = axial * across**2 + shear * along**2 - normal * along - transverse * across

        for a, sign_a in ((i, -1.0), (j, 1.0)):
            force[a] += sign_a * f_x
            force[a + 1] += sign_a * f_y
            force[a + 2] += 0.5 * length * f_t + sign_a * moment
            for b, sign_b in ((i, -1.0), (j, 1.0)):
                both = sign_a * sign_b / length
                tangent[a, b] += both * k_xx
                tangent[a, b + 1] += both * k_xy
                tangent[a + 1, b] += both * k_xy
                tangent[a + 1, b + 1] += both * k_yy
                tangent[a, b + 2] += 0.5 * sign_a * k_xt
                tangent[a + 2, b] += 0.5 * sign_b * k_xt
                tangent[a + 1, b + 2] += 0.5 * sign_a * k_yt
                tangent[a + 2, b + 1] += 0.5 * sign_b * k_yt
                tangent[a + 2, b + 2] += 0.25 * length * k_tt + both * bending
    return energy, force, tangent


class TimoshenkoBeam:
    """A cantilever of equal elements with a rectangular section that bends along its height.

    The n = 3 × elements unknowns are u, w, θ of the first free node, then of the next.

    Attributes:
        elements: number of elements; the nodes are 0 (clamped) to `elements` (the tip).
        length: length of the beam, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².
        linear: whether displacements are small, so that `stiffness` is the tangent everywhere.
        mass: consistent mass (n, n), kg, kg m and kg m².
        stiffness: tangent of the undeformed beam (n, n).
        load_node: node at which the load acts.
        translated: (n, 2) load vectors of unit accelerations along and across the beam, kg.
    """

    def __init__(
        self, section: BeamSection, material: Material, linear: bool, source: str = "scene"
    ):
        """Build the beam.

        Args:
            section: length, height and width in m, number of elements, and position of the load as
                a fraction of the length.
            material: Young's modulus in Pa, Poisson's ratio, density in kg/m³.
            linear: whether displacements are small.
            source: name of the scene file, for messages.

        Raises:
            SceneError: the load is not at a free node.
        """
        area = section.width * section.height
        inertia = section.width * section.height**3 / 12.0
        young, poisson = material.isotropic_constants
        self.elements, self.length, self.linear = section.elements, section.length, linear
        self.axial, self.bending = young * area, young * inertia
        element = self.length / self.elements
        section_shear = SHEAR_CORRECTION * self.axial / (2.0 * (1.0 + poisson))
        self.shear = 1.0 / (1.0 / section_shear + element**2 / (12.0 * self.bending))
        line = _consistent_mass(self.elements)
        each = np.diag(material.density * element * np.array([area, area, inertia]))
        self.mass: Array = np.asarray(np.kron(line[1:, 1:], each), np.float64)
        translated = np.kron(line[1:].sum(axis=1)[:, None], each[:, :2])
        self.translated: Array = np.asarray(translated, np.float64)
        tangent = self._free(np.zeros(UNKNOWNS * self.elements))[2]
        self.stiffness = tangent[UNKNOWNS:, UNKNOWNS:].copy()
        self.load_node = _node_at(section.load_at, self.elements, source)

    @property
    def tip_node(self) -> int:
        """The node at x = length."""
        return self.elements

    def unknown(self, node: int, component: int) -> int:
        """Index of an unknown.

        Args:
            node: 1 (next to the clamp) to `elements` (the tip).
            component: 0 for u (along the beam), 1 for w (across), 2 for θ (from the first axis to
                the second).
        """
        return UNKNOWNS * (node - 1) + component

    def elastic(self, q: Array) -> tuple[Array, Array]:
        """Elastic force (n,) and its tangent (n, n) at the unknowns q (n,).

        The tangent of a linear beam is `stiffness` itself, not a copy.
        """
        if self.linear:
            return self.stiffness @ q, self.stiffness
        _, force, tangent = self._free(q)
        return force[UNKNOWNS:], tangent[UNKNOWNS:, UNKNOWNS:]

    def energy(self, q: Array) -> float:
        """Elastic energy at the unknowns q (n,), J."""
        if self.linear:
            return float(0.5 * q @ self.stiffness @ q)
        return float(self._free(q)[0])

    def _free(self, q: Array) -> tuple[float, Array, Array]:
        """Energy, force and tangent at q (n,), with the unknowns of the clamped node first."""
        nodes = np.concatenate((np.zeros(UNKNOWNS), q))
        energy, force, tangent = _assemble(
            nodes, self.length / self.elements, self.axial, self.shear, self.bending
        )
        return energy, force, tangent


def _consistent_mass(elements: int) -> Array:
    """Consistent mass matrix of the nodes of one component, for elements of inertia 1."""
    first, second = np.eye(elements + 1)[:-1], np.eye(elements + 1)[1:]
    line = (2.0 * (first.T @ first + second.T @ second) + first.T @ second + second.T @ first) / 6.0
    return np.asarray(line, np.float64)


def _node_at(fraction: float, elements: int, source: str) -> int:
    """The free node at a fraction of the length.

    Raises:
        SceneError: there is no free node.
    """
    place = fraction * elements
    node = round(place)
    if abs(place - node) <= 1e-9 and 1 <= node <= elements:
        return node
    nearest = {min(max(k, 1), elements) for k in (int(np.floor(place)), int(np.ceil(place)))}
    places = " or ".join(f"{k / elements:.12g}" for k in sorted(nearest))
    allowed = f"must be at a free node of the {elements} elements; the nearest is at {places}"
    raise Where(source, "reference.beam_section.load_at").refuse(fraction, allowed)

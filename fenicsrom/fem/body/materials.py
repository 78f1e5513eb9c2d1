"""The materials of a mesh: which cell has which, and the coefficients of the forms.

A scene with one isotropic material has constants in its forms. Otherwise the coefficients are
constant in each cell: λ and μ if all materials are isotropic, else the elasticity tensor in
Mandel's notation (`fenicsrom.online.stress.stress`).
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import Mesh
from fenicsrom.online.stress.stress import mandel_basis, stiffness
from fenicsrom.scene import Elasticity, Scene
from fenicsrom.scene.base.rules import Where

Expression = ufl.core.expr.Expr


class Materials:
    """The materials of a body.

    Attributes:
        every: the materials, that of [material] first.
        number: (cells,) number of the material of each local cell, ghosts included.
        thickness: (materials,) thickness of each material, m; 1 in 3D.
    """

    def __init__(self, mesh: Mesh, scene: Scene):
        """Assign the materials to the cells.

        Raises:
            SceneError: the mesh has no such group, or a cell is in two groups with materials.
        """
        topology, groups = mesh.domain.topology, scene.materials
        index_map = topology.index_map(topology.dim)
        self.every: tuple[Elasticity, ...] = (scene.material, *groups)
        self.number = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=np.int64)
        for k, group in enumerate(groups):
            cells = mesh.cells(group.group)
            taken = np.max(self.number[cells], initial=0)
            other = max(mesh.domain.comm.allgather(int(taken)))
            if other and not groups[other - 1].group.startswith("@"):  # else of a whole sector
                common = f"has cells in common with group {groups[other - 1].group!r}"
                where = Where(scene.source, f"materials[{k}].group")
                allowed = f"{common}; each cell must have one material"
                raise where.refuse(group.group, allowed, ErrorKind.CONFLICT)
            self.number[cells] = 1 + k
        whole = scene.geometry.thickness or 1.0
        self.thickness = np.array([whole, *(group.thickness or whole for group in groups)])
        self._mesh, self._geometry = mesh, scene.geometry

    @property
    def isotropic(self) -> bool:
        """Whether every material is isotropic."""
        return all(material.is_isotropic for material in self.every)

    def lame(self, k: int = 0) -> tuple[float, float]:
        """The Lamé parameters λ (λ* in plane stress) and μ of an isotropic material, Pa."""
        young, poisson = self.every[k].isotropic_constants
        mu = young / (2.0 * (1.0 + poisson))
        lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        if self._geometry.plane == "stress":
            lame = 2.0 * lame * mu / (lame + 2.0 * mu)
        return lame, mu

    def tensor(self, k: int) -> Array:
        """The elasticity tensor (m, m) of a material, Pa."""
        return stiffness(self.every[k], self._geometry.dimension, self._geometry.plane)

    def cells(self) -> Iterator[tuple[int, npt.NDArray[np.int32]]]:
        """Yield each material and the cells of this rank that have it, ghosts left out."""
        topology = self._mesh.domain.topology
        owned = self.number[: topology.index_map(topology.dim).size_local]
        for k in range(len(self.every)):
            yield k, np.flatnonzero(owned == k).astype(np.int32)

    def of_points(
        self, points: int, cells: npt.NDArray[np.int32] | None = None
    ) -> npt.NDArray[np.int64]:
        """Number of the material of each of some points of each cell, by default the owned ones."""
        topology = self._mesh.domain.topology
        own = self.number[: topology.index_map(topology.dim).size_local]
        return np.repeat(own if cells is None else self.number[cells], points)

    @property
    def has_one_thickness(self) -> bool:
        """Whether all materials have the same thickness."""
        return bool(np.all(self.thickness == self.thickness[0]))

    def field(self, values: Sequence[Any]) -> Expression:
        """A coefficient of the forms from its value in each material: numbers or matrices."""
        domain = self._mesh.domain
        if len(self.every) == 1 and np.ndim(values[0]) == 0:
            return fem.Constant(domain, np.float64(values[0]))
        each = np.array(values, dtype=np.float64)
        element = basix.ufl.element(
            "Discontinuous Lagrange", domain.basix_cell(), 0, shape=each.shape[1:] or None
        )
        space = fem.functionspace(domain, element)
        function = fem.Function(space)
        in_cells = function.x.array.reshape(-1, each[0].size)
        in_cells[space.dofmap.list[:, 0]] = each[self.number].reshape(len(self.number), -1)
        return function

    def thickness_field(self) -> Expression:
        """The thickness as a coefficient of the forms, m."""
        if self.has_one_thickness:
            return fem.Constant(self._mesh.domain, np.float64(self.thickness[0]))
        return self.field(list(self.thickness))

    def density_field(self) -> Expression:
        """Mass per volume, or per area in 2D, as a coefficient of the forms."""
        pairs = zip(self.every, self.thickness, strict=True)
        return self.field([material.density * float(size) for material, size in pairs])

    def stress(self) -> Callable[[Expression], Expression]:
        """The law S(E) of the forms, multiplied by the thickness."""
        d, count = self._geometry.dimension, len(self.every)
        thickness = [float(size) for size in self.thickness]
        if self.isotropic:
            pairs = [np.multiply(self.lame(k), thickness[k]) for k in range(count)]
            lame, mu = (self.field([pair[i] for pair in pairs]) for i in range(2))

            def isotropic(strain: Expression) -> Expression:
                return lame * ufl.tr(strain) * ufl.Identity(d) + 2.0 * mu * strain

            return isotropic
        tensor = self.field([self.tensor(k) * thickness[k] for k in range(count)])
        basis = mandel_basis(d)

        def anisotropic(strain: Expression) -> Expression:
            vector = [
                sum(float(b[i, j]) * strain[i, j] for i, j in np.argwhere(b).tolist())
                for b in basis
            ]
            found = ufl.dot(tensor, ufl.as_vector(vector))

            def entry(i: int, j: int) -> Expression:
                parts = enumerate(basis[:, i, j].tolist())
                return sum(part * found[k] for k, part in parts if part)

            return ufl.as_matrix([[entry(i, j) for j in range(d)] for i in range(d)])

        return anisotropic

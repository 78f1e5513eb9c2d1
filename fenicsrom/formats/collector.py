"""Collects materials, supports, masses and loads of a finite-element model while it is read."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np

from fenicsrom.formats.mesh_file import Floats, Ints, Marks, MeshFile
from fenicsrom.formats.physics import DeckLoad, DeckMaterial, Physics, axes_of
from fenicsrom.words import counted

MOST_FORCES = 20
"""Forces at more nodes are not taken: they stand for a distributed load."""


@dataclass(eq=False)
class Collector:
    """Collects what a file holds besides its mesh.

    Attributes:
        constants: numbers of each material by its name: "E", "nu", "rho".
        cells: marks of the cells of each block (`MeshFile.blocks`) that have a material.
        held: components that are held at the nodes of each group by its name.
        held_nodes: the nodes of these groups.
        masses: mass at each node.
        springs: stiffness of the springs to the ground by node and component.
        forces: force (3,) at each node.
        others: pressures and accelerations.
        not_taken: what a scene cannot state, each in a few words, in their order.
    """

    constants: dict[str, dict[str, float]] = field(default_factory=lambda: defaultdict(dict))
    cells: dict[str, list[Marks]] = field(default_factory=dict)
    held: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    held_nodes: dict[str, Ints] = field(default_factory=dict)
    masses: dict[int, float] = field(default_factory=lambda: defaultdict(float))
    springs: dict[tuple[int, int], float] = field(default_factory=lambda: defaultdict(float))
    forces: dict[int, Floats] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    others: list[DeckLoad] = field(default_factory=list)
    not_taken: dict[str, None] = field(default_factory=dict)

    def cells_of(self, material: str, mesh: MeshFile) -> list[Marks]:
        """The marks of the cells of a material in each block, to be changed."""
        none = [np.zeros(len(block.nodes), dtype=bool) for block in mesh.blocks]
        return self.cells.setdefault(material, none)

    def hold(self, name: str, nodes: Ints, components: set[int]) -> None:
        """Hold components of the nodes of a group; rotations (3 to 5) mean nothing for a solid."""
        components = components & {0, 1, 2}
        if components and len(nodes):
            known = self.held_nodes.get(name)
            if known is not None and len(known) != len(np.union1d(known, nodes)):
                nodes = np.union1d(known, nodes)
            self.held[name] |= components
            self.held_nodes[name] = nodes

    def is_held(self, node: int, component: int) -> bool:
        """Whether a component of a node is held, by the supports up to now."""
        return any(
            component in components and node in self.held_nodes[name]
            for name, components in self.held.items()
        )

    def spring(self, nodes: list[int], components: list[int], stiffness: float | None) -> bool:
        """Take a spring between these components of nodes, if one of them or the ground is held.

        Returns:
            Whether it was taken; others act between two points, or about an axis.
        """
        free = [end for end in zip(nodes, components, strict=True) if not self.is_held(*end)]
        if len(free) != 1 or free[0][1] not in (0, 1, 2) or stiffness is None:
            return False
        self.springs[free[0]] += stiffness
        return True

    def leave(self, what: str) -> None:
        """Name something that a scene cannot state."""
        self.not_taken[what] = None

    def finished(self, mesh: MeshFile) -> MeshFile:
        """Give the mesh with its physics, and with the groups that it needs."""
        solid = max((block.shape.dimension for block in mesh.blocks), default=0)
        cells = [b.nodes.ravel() for b in mesh.blocks if b.shape.dimension == solid]
        used = set(np.unique(np.concatenate(cells)).tolist()) if cells else set()
        groups = dict(mesh.node_groups)
        supports = []
        for name, components in self.held.items():
            nodes = np.unique(self.held_nodes[name])
            if name not in groups or not np.array_equal(np.sort(groups[name]), nodes):
                name = name if name not in groups else f"{name} {axes_of(components)}"
                groups[name] = nodes
            supports.append((name, tuple(sorted(components))))
        materials = self._materials(mesh, solid)

        def place(node: int) -> tuple[float, ...]:
            return tuple(float(x) for x in mesh.points[node])

        masses = [(place(n), mass) for n, mass in self.masses.items() if n in used and mass]
        self._leave_away("point mass", "attachments", [n for n in self.masses if n not in used])
        springs = [(place(n), k, value) for (n, k), value in self.springs.items() if n in used]
        self._leave_away("spring", "attachments", [n for n, _ in self.springs if n not in used])
        loads = list(self.others)
        near = {node: force for node, force in self.forces.items() if force.any()}
        if len(near) > MOST_FORCES:
            total = sum(near.values(), np.zeros(3))
            listed = ", ".join(f"{value:.6g}" for value in total)
            self.leave(f"forces at {len(near)} nodes, in total ({listed})")
        else:
            self._leave_away("force", "loads", [n for n in near if n not in used])
            loads += [
                DeckLoad("force", tuple(force.tolist()), place(node))
                for node, force in near.items()
                if node in used
            ]
        physics = Physics(
            materials,
            tuple(supports),
            tuple(masses),
            tuple(springs),
            tuple(loads),
            tuple(self.not_taken),
        )
        return replace(mesh, node_groups=groups, physics=physics)

    def _leave_away(self, what: str, table: str, nodes: list[int]) -> None:
        if nodes:
            number = counted(len(nodes), what, f"{what}{'es' if what[-1] == 's' else 's'}")
            self.leave(f"{number} at nodes beside the solid; [[{table}]] can act on a group of it")

    def _materials(self, mesh: MeshFile, solid: int) -> tuple[DeckMaterial, ...]:
        """The materials of the cells, each of several with a group of its own."""
        whole = [block.shape.dimension == solid for block in mesh.blocks]
        used = {
            name: marks
            for name, marks in self.cells.items()
            if any(m.any() for m, is_cell in zip(marks, whole, strict=True) if is_cell)
        }
        if not used and len(self.constants) == 1:
            used = {next(iter(self.constants)): []}
        found = []
        for name, marks in used.items():
            constants = self.constants.get(name, {})
            if "E" not in constants or "nu" not in constants:
                self.leave(f"the material {name}, which is not isotropic and linear elastic")
                continue
            group = None
            if len(used) > 1:
                group = self._cell_group(mesh, name, marks)
            density = constants.get("rho")
            found.append(DeckMaterial(name, constants["E"], constants["nu"], density, group))
        return tuple(found)

    def _cell_group(self, mesh: MeshFile, name: str, marks: list[Marks]) -> str:
        """The name of a group of the cells with a material; a new group if there is none."""
        every = dict.fromkeys(group for block in mesh.blocks for group in block.groups)
        for group in every:
            same = (
                np.array_equal(block.groups.get(group, np.zeros(len(block.nodes), bool)), mark)
                for block, mark in zip(mesh.blocks, marks, strict=True)
            )
            if all(same):
                return group
        new = name if name not in every else f"{name} (material)"
        for block, mark in zip(mesh.blocks, marks, strict=True):
            if mark.any():
                block.groups[new] = mark
        return new

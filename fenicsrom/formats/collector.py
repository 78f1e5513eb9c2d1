"""Collects materials, supports, masses and loads of a finite-element model from its text files."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.formats.couplings import Component, Couplings
from fenicsrom.formats.mesh_file import (
    Block,
    DeckJoint,
    DeckLoad,
    DeckMaterial,
    DeckSupport,
    Floats,
    Ints,
    Marks,
    MeshFile,
    Physics,
    axes_of,
)
from fenicsrom.formats.nodal_forces import MOST_TABLES, forces_on
from fenicsrom.words import counted

DEEPEST = 16
"""Files may include files to this depth; a file that includes itself would never end."""


MOST_NUMBERS = 10_000_000
"""A range of more numbers is damaged, and would fill the memory."""


def numbers_between(first: int, last: int, step: int = 1) -> range:
    """The numbers from the first to the last one, included.

    Raises:
        ValueError: the step is 0, or the range is too long.
    """
    found = range(first, last + 1, step)
    if last - first > MOST_NUMBERS * abs(step):
        raise ValueError(f"{first} to {last}: more than {MOST_NUMBERS} numbers")
    return found


def content_of(path: Path) -> bytes:
    """The bytes of a file.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise refuse(path, f"cannot be read: {error.strerror}", ErrorKind.FILE) from None


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without the ends of the lines."""
    text = content_of(path).decode("utf-8-sig", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Refuse a file whose content raises an error where it is read.

    Raises:
        SceneError: the file is damaged.
    """
    try:
        yield
    except SceneError:
        raise
    except RecursionError:
        reason = "its sets or coordinate systems refer to each other without end"
        raise refuse(path, reason) from None
    except (ArithmeticError, LookupError, StopIteration, ValueError) as error:
        reason = (
            f"cannot be read; the file may be truncated or damaged ({error or 'it ends early'})"
        )
        raise refuse(path, reason) from None


def included(path: Path, name: str, what: str, depth: int) -> Path:
    """Find a file that another file includes.

    Args:
        path: the file that includes it.
        name: its path in that file, relative to the folder of that file.
        what: the keyword, for messages.
        depth: number of files that include each other so far.

    Raises:
        SceneError: the file does not exist, or files include each other without end.
    """
    found = path.parent / name.strip().strip("'\"").replace("\\", "/")
    if not found.is_file():
        raise refuse(path, f"{what} {name.strip()}: there is no file {found}", ErrorKind.FILE)
    if depth >= DEEPEST:
        raise refuse(path, f"{what} {name.strip()}: files include each other without end")
    return found


@dataclass(eq=False)
class Collector:
    """Collects what a file holds besides its mesh.

    Attributes:
        constants: numbers of each material of the file by its name: "E", "nu", "rho".
        cells: marks of the cells of each block (`MeshFile.blocks`) that have a material.
        held: nodes and components of each group that is held, by its name.
        fixed: the components that are held.
        turned: nodes whose components are along axes of their own.
        following: nodes of the cut face of a sector that moves as the other cut face.
        couplings: the equations between components.
        masses: mass at each node.
        springs: stiffness of the springs to the ground by component.
        forces: force (3,) at each node.
        pressures: facets under each pressure.
        others: other loads.
        thickness: thickness of a plane body.
        strain: whether its strains, not its stresses, are plane.
        not_taken: what a scene cannot state, each in a few words, in their order.
        lost_support: whether a support is among it.
        joints: contacts and ties between surfaces.
        surfaces: facets of surfaces that the mesh does not hold yet, by the names of their groups.
    """

    constants: dict[str, dict[str, float]] = field(default_factory=lambda: defaultdict(dict))
    cells: dict[str, list[Marks]] = field(default_factory=dict)
    held: dict[str, tuple[Ints, set[int]]] = field(default_factory=dict)
    fixed: set[Component] = field(default_factory=set)
    turned: set[int] = field(default_factory=set)
    following: set[int] = field(default_factory=set)
    couplings: Couplings = field(default_factory=Couplings)
    masses: dict[int, float] = field(default_factory=lambda: defaultdict(float))
    springs: dict[Component, float] = field(default_factory=lambda: defaultdict(float))
    forces: dict[int, Floats] = field(default_factory=lambda: defaultdict(lambda: np.zeros(3)))
    pressures: dict[float, list[Block]] = field(default_factory=lambda: defaultdict(list))
    others: list[DeckLoad] = field(default_factory=list)
    thickness: float | None = None
    strain: bool = False
    not_taken: dict[str, None] = field(default_factory=dict)
    lost_support: bool = False
    joints: list[DeckJoint] = field(default_factory=list)
    surfaces: dict[str, list[Block]] = field(default_factory=dict)

    def cells_of(self, material: str, mesh: MeshFile) -> list[Marks]:
        """The marks of the cells of a material in each block, to be changed."""
        none = [np.zeros(len(block.nodes), dtype=bool) for block in mesh.blocks]
        return self.cells.setdefault(material, none)

    def hold(self, name: str, nodes: Iterable[int], components: set[int]) -> None:
        """Hold components (0 to 5) of the nodes of a group; rotations matter for couplings only.

        Some displacements along other axes than x, y and z are left, but not all three of them.
        """
        moved, own = components & {0, 1, 2}, set(nodes)
        if len(moved) in (1, 2) and (turned := own & self.turned):
            along = f"{counted(len(turned), 'node')} held along axes of their own"
            self.leave(f"the support {name}: {along}; [[supports]] can have a normal", True)
            own -= turned
        self.fixed |= {(node, k) for node in own for k in components}
        if not moved or not own:
            return
        held = np.array(sorted(own), dtype=np.int64)
        while name in self.held:
            known, before = self.held[name]
            if np.array_equal(known, held) or before == moved:
                held, moved = np.union1d(known, held), moved | before
                break
            name = f"{name} {axes_of(moved)}"  # the same name at another place
        self.held[name] = held, moved

    def release(self) -> None:
        """Forget all supports."""
        self.held.clear()
        self.fixed.clear()

    def spring(self, nodes: list[int], components: list[int], stiffness: float | None) -> bool:
        """Take a spring between these components of nodes, if one of them or the ground is held.

        Returns:
            Whether it was taken; others act between two points, or about an axis.
        """
        ends = zip(nodes, components, strict=True)
        free = [end for end in ends if end not in self.fixed]
        if len(free) != 1 or free[0][1] not in (0, 1, 2) or stiffness is None:
            return False
        self.springs[free[0]] += stiffness
        return True

    def leave(self, what: str, support: bool = False) -> None:
        """Name something, such as a support, that a scene cannot state."""
        self.not_taken[what] = None
        self.lost_support |= support

    def finished(self, mesh: MeshFile) -> MeshFile:
        """Give the mesh with its physics, and with the groups that it needs."""
        solid = max((block.shape.dimension for block in mesh.blocks), default=0)
        cells = [block for block in mesh.blocks if block.shape.dimension == solid]
        used = {int(node) for block in cells for node in np.unique(block.nodes)}
        groups = _beside_facets(mesh, solid)
        supports = self._supports(mesh, cells, used, groups)
        materials = self._materials(mesh, solid)

        def place(node: int) -> tuple[float, ...]:
            return tuple(float(x) for x in mesh.points[node])

        masses = [(place(n), mass) for n, mass in self.masses.items() if n in used and mass]
        self._leave_away("point mass", "attachments", [n for n in self.masses if n not in used])
        springs = [(place(n), k, value) for (n, k), value in self.springs.items() if n in used]
        self._leave_away("spring", "attachments", [n for n, _ in self.springs if n not in used])
        near = {node: force for node, force in self.forces.items() if force.any()}
        near, rigid = self.couplings.spread(near, mesh.points, used)
        if rigid:
            self.leave(f"{counted(rigid, 'force')} on rigid parts, spread over their nodes instead")
        self._leave_away("force", "loads", [n for n in near if n not in used])
        near = self._moving({node: force for node, force in near.items() if node in used})
        forces, left = forces_on(mesh.points, cells, near, groups)
        self.not_taken |= dict.fromkeys(left)
        blocks, pressures = self._pressures(groups)
        blocks += [block for facets in self.surfaces.values() for block in facets]
        physics = Physics(
            materials,
            supports=tuple(supports),
            masses=tuple(masses),
            springs=tuple(springs),
            loads=(*self.others, *pressures, *forces),
            not_taken=tuple(self.not_taken),
            thickness=self.thickness,
            strain=self.strain,
            lost_support=self.lost_support,
            joints=tuple(self.joints),
        )
        return replace(mesh, blocks=(*mesh.blocks, *blocks), node_groups=groups, physics=physics)

    def _moving(self, forces: dict[int, Floats]) -> dict[int, Floats]:
        """The forces (3,) at nodes without the components that act on a support only."""
        found = {}
        for node, force in forces.items():
            kept = np.array([0.0 if (node, k) in self.fixed else force[k] for k in range(3)])
            if kept.any():
                found[node] = kept
        if held := len(forces) - len(found):
            self.leave(f"{counted(held, 'force')} at held nodes")
        return found

    def _supports(
        self, mesh: MeshFile, cells: list[Block], used: set[int], groups: dict[str, Ints]
    ) -> list[DeckSupport]:
        """The supports of the solid, whose groups are added to the groups of nodes.

        A group of a scene consists of corners, and of the edges between them. Nodes on other edges
        are held by their coordinates.
        """
        for name, passed in self.couplings.solve(self.fixed).items():
            for components in {frozenset(entry) for entry in passed.values()}:
                own = [node for node, entry in passed.items() if entry == components]
                self.hold(name, own, set(components))
        self._leave_couplings()
        found: list[DeckSupport] = []
        points, taken = mesh.points, {name for block in mesh.blocks for name in block.groups}
        axes = set(range(cells[0].shape.dimension)) if cells else set()
        for name, (nodes, components) in self.held.items():
            held = tuple(sorted(components & axes))
            own = [node for node in self._with_following(nodes, cells, groups) if node in used]
            if away := set(nodes.tolist()) - used - self.couplings.through:
                beside = f"the support {name} of {counted(len(away), 'node')} beside the solid"
                self.leave(f"{beside}; [[supports]] can hold a group of it", True)
            alone = _alone(cells, np.array(own, dtype=np.int64)) if held else set()
            if len(alone) > MOST_TABLES:
                self.leave(
                    f"the support {name} of {len(alone)} nodes in the middle of edges whose ends "
                    "are not held; [[supports]] can hold a group of facets",
                    True,
                )
            else:
                found += [(tuple(points[node].tolist()), held) for node in sorted(alone)]
            if held and (kept := [node for node in own if node not in alone]):
                same = [group for group, of in groups.items() if np.array_equal(np.sort(of), kept)]
                if not same:
                    is_free = name not in groups and name not in taken
                    same = [name if is_free else f"{name} {axes_of(components)}"]
                    groups[same[0]] = np.array(kept)
                found.append((name if name in same else same[0], held))
        return found

    def _with_following(
        self, nodes: Ints, cells: list[Block], groups: dict[str, Ints]
    ) -> list[int]:
        """These nodes, with those of the following face that decks of CalculiX must not hold.

        They are those of a group; or the ends of edges whose middle nodes are held, and the middle
        nodes of edges whose ends are held.
        """
        own, wholes = set(nodes.tolist()), (set(of.tolist()) for of in groups.values())
        found = max((of for of in wholes if of - self.following == own), key=len, default=own)
        edges = [
            block.nodes[:, [*ends, block.shape.corners + k]]
            for block in (cells if self.following else ())
            for k, ends in enumerate(block.shape.edges[: block.shape.nodes - block.shape.corners])
        ]
        for rows in edges:
            found |= self.following & set(rows[np.isin(rows[:, 2], nodes), :2].ravel().tolist())
        for rows in edges:
            is_held = np.isin(rows[:, :2], [*found]).all(axis=1)
            found |= self.following & set(rows[is_held, 2].tolist())
        return sorted(found)

    def _leave_couplings(self) -> None:
        """Name the couplings of nodes that can move."""
        for kind, number in self.couplings.left(self.fixed).items():
            reason = "whose nodes can move or turn: a scene has no rigid parts and no equations"
            self.leave(f"{number} {kind} {reason}")

    def _pressures(self, groups: dict[str, Ints]) -> tuple[list[Block], list[DeckLoad]]:
        """The facets under pressure, as blocks with a group for each pressure, and the loads."""
        blocks: list[Block] = []
        loads: list[DeckLoad] = []
        if len(self.pressures) > MOST_TABLES:
            self.leave(f"pressures of {len(self.pressures)} sizes on faces of elements")
            return blocks, loads
        for value, facets in self.pressures.items():
            name = f"pressure {value!r}".removesuffix(".0")
            marked = [np.ones(len(block.nodes), dtype=bool) for block in facets]
            pairs = zip(facets, marked, strict=True)
            blocks += [replace(block, groups={name: marks}) for block, marks in pairs]
            loads.append(DeckLoad("pressure", (value,), group=name))
        return blocks, loads

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
        if not used.keys() & self.constants.keys():
            return ()
        found = []
        for name, marks in used.items():
            constants = self.constants.get(name)
            group = self._cell_group(mesh, name, marks) if len(used) > 1 else None
            if constants is None or "E" not in constants or "nu" not in constants:
                why = "is not in the file" if constants is None else "is not isotropic and elastic"
                self.leave(f"the material {name}, which {why}")
                found.append(DeckMaterial(name, None, None, None, group))
                continue
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


def _beside_facets(mesh: MeshFile, solid: int) -> dict[str, Ints]:
    """The groups of nodes, with other names beside facets of one name that lie elsewhere.

    A place of a scene takes the facets of a name.
    """
    sides: dict[str, set[int]] = defaultdict(set)
    for block in mesh.blocks if solid > 1 else ():
        if block.shape.dimension == solid - 1:
            for name, marks in block.groups.items():
                sides[name].update(block.nodes[marks].ravel().tolist())
    found = {}
    for name, nodes in mesh.node_groups.items():
        is_elsewhere = name in sides and sides[name] != set(nodes.tolist())
        found[f"{name} (nodes)" if is_elsewhere else name] = nodes
    return found


def _alone(cells: list[Block], nodes: Ints) -> set[int]:
    """The nodes on edges whose ends are not among the nodes as well."""
    found: set[int] = set()
    for block in cells:
        for k, edge in enumerate(block.shape.edges[: block.shape.nodes - block.shape.corners]):
            middle = block.nodes[:, block.shape.corners + k]
            rows = np.flatnonzero(np.isin(middle, nodes))
            ends = np.isin(block.nodes[rows][:, list(edge)], nodes).all(axis=1)
            found |= set(middle[rows[~ends]].tolist())
    return found

"""What couples nodes in Abaqus and CalculiX files: couplings, rigid bodies, *MPC and *EQUATION."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fenicsrom.formats.abaqus_sets import OF_ELEMENTS, Keyword
from fenicsrom.formats.couplings import Couplings
from fenicsrom.formats.mesh_file import Floats, Ints

KEYWORDS = (
    *("COUPLING", "KINEMATIC", "DISTRIBUTING", "KINEMATIC COUPLING", "DISTRIBUTING COUPLING"),
    *("RIGID BODY", "MPC", "EQUATION"),
)

EVERY = set(range(6))
"""Displacements and rotations."""

RIGID = {"BEAM": EVERY, "TIE": EVERY, "PIN": {0, 1, 2}}
"""Components that the types of *MPC couple."""

NodesOf = Callable[[str], Ints]
"""Gives the nodes of a number, a set or a surface."""


@dataclass(eq=False)
class Reader:
    """Reads couplings.

    Attributes:
        couplings: the equations that were read.
        points: coordinates of the nodes, shape (n, 3).
        current: name, reference node and nodes of the *COUPLING whose data follow.
    """

    couplings: Couplings
    points: Floats
    current: tuple[str, int, Ints] | None = None

    def take(self, keyword: Keyword, rows: list[list[str]], nodes_of: NodesOf) -> bool:
        """Take one of KEYWORDS; whether it was understood.

        Raises:
            ValueError, IndexError: it is damaged.
            SceneError: a set or surface is missing.
        """
        name, given = keyword.name, keyword.parameters
        if name == "COUPLING":
            label = f"coupling {given.get('CONSTRAINT NAME', given.get('SURFACE', ''))}".strip()
            surface = nodes_of(given["SURFACE"])
            self.current = label, _only(nodes_of(given["REF NODE"])), surface
        elif name == "KINEMATIC" and self.current is not None:
            self._rigid("*KINEMATIC", *self.current, _components(rows))
        elif name == "DISTRIBUTING" and self.current is not None:
            self._mean(*self.current)
        elif name in ("KINEMATIC COUPLING", "DISTRIBUTING COUPLING"):
            reference = _only(nodes_of(given["REF NODE"]))
            for row in rows:
                one = f"coupling {given['REF NODE']}", reference, nodes_of(row[0])
                if name == "DISTRIBUTING COUPLING":
                    self._mean(*one)
                else:
                    self._rigid("*KINEMATIC COUPLING", *one, _components([row[1:]]))
        elif name == "RIGID BODY":
            return self._rigid_body(keyword, nodes_of)
        elif name == "MPC":
            return self._mpc(rows, nodes_of)
        elif name == "EQUATION":
            self._equation(rows, nodes_of)
        else:
            return False
        return True

    def _rigid(
        self, kind: str, name: str, reference: int, nodes: Ints, components: set[int]
    ) -> None:
        self.couplings.rigid(kind, name, reference, nodes, components, self.points)

    def _mean(self, name: str, reference: int, nodes: Ints) -> None:
        nodes = nodes[nodes != reference]
        self.couplings.mean("*DISTRIBUTING", name, reference, nodes, np.ones(len(nodes)))

    def _rigid_body(self, keyword: Keyword, nodes_of: NodesOf) -> bool:
        """Take *RIGID BODY; in CalculiX, a node of its own has the rotations as displacements."""
        given = keyword.parameters
        reference = _only(nodes_of(given["REF NODE"]))
        name = f"rigid body {given['REF NODE']}"
        for key, components in (
            *(("NSET", EVERY), ("TIE NSET", EVERY), ("PIN NSET", {0, 1, 2})),
            ("ELSET", {0, 1, 2}),
        ):
            if key in given:
                nodes = nodes_of((OF_ELEMENTS if key == "ELSET" else "") + given[key])
                self._rigid("*RIGID BODY", name, reference, nodes, components)
        if "ROT NODE" in given:
            turned = _only(nodes_of(given["ROT NODE"]))
            for k in range(3):
                self.couplings.add("*RIGID BODY", name, [(reference, 3 + k), (turned, k)])
        return True

    def _mpc(self, rows: list[list[str]], nodes_of: NodesOf) -> bool:
        """Take a rigid beam, a tie or a pin."""
        kind, first, second, *_ = [*rows[0], "", ""]
        if kind.upper() not in RIGID:
            return False
        nodes, others = nodes_of(first), nodes_of(second)
        name = f"MPC {first}"
        for node, reference in zip(nodes, np.broadcast_to(others, nodes.shape), strict=True):
            at = int(reference), np.array([node])
            self._rigid(f"*MPC {kind.upper()}", name, *at, RIGID[kind.upper()])
        return True

    def _equation(self, rows: list[list[str]], nodes_of: NodesOf) -> None:
        """Take equations: the number of terms, then node or set, component and factor of each."""
        words = [word for row in rows for word in row]
        at = 0
        while at < len(words):
            count = int(words[at])
            terms = [words[at + 1 + 3 * k : at + 4 + 3 * k] for k in range(count)]
            at += 1 + 3 * count
            sets = [nodes_of(node) for node, _, _ in terms]
            for row in range(len(sets[0])):
                own = [
                    (int(nodes[row if len(nodes) > 1 else 0]), int(component) - 1)
                    for nodes, (_, component, factor) in zip(sets, terms, strict=True)
                    if float(factor)
                ]
                self.couplings.add("*EQUATION", "*EQUATION", own)


def _only(nodes: Ints) -> int:
    """The only node of a set.

    Raises:
        ValueError: there are several, or none.
    """
    (node,) = nodes.tolist()
    return int(node)


def _components(rows: list[list[str]]) -> set[int]:
    """The components (0 to 5) of rows with the first and the last one; all without rows."""
    found: set[int] = set()
    for row in rows:
        numbers = [int(word) for word in row if word]
        if numbers:
            found |= set(range(numbers[0] - 1, numbers[-1]))
    return found or EVERY

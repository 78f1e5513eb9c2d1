"""Equations that couple displacements of nodes, and what they hold together with supports."""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fenicsrom.formats.mesh_file import Floats, Ints

ROUNDING = 1e-9
"""Smaller distances, relative to the extent of the nodes, count as zero."""

Component = tuple[int, int]
"""A node, and its displacement (0 to 2) or rotation (3 to 5)."""


class Equation(NamedTuple):
    """An equation without a constant.

    Attributes:
        kind: what gives it, such as "RBE2".
        name: which one, such as "RBE2 7"; the kind for one of many equations.
        terms: what it contains with a factor that is not zero.
    """

    kind: str
    name: str
    terms: list[Component]


@dataclass(eq=False)
class Couplings:
    """The equations of a file.

    Attributes:
        equations: the equations.
        means: nodes and weights of the mean that each reference node follows.
        followers: nodes that move with each reference node as a rigid body.
        through: nodes that pass their support on to others.
    """

    equations: list[Equation] = field(default_factory=list)
    means: dict[int, tuple[Ints, Floats]] = field(default_factory=dict)
    followers: dict[int, set[int]] = field(default_factory=lambda: defaultdict(set))
    through: set[int] = field(default_factory=set)

    def add(self, kind: str, name: str, terms: list[Component]) -> None:
        """Add an equation."""
        self.equations.append(Equation(kind, name, terms))

    def rigid(
        self, kind: str, name: str, reference: int, nodes: Ints, components: set[int], x: Floats
    ) -> None:
        """Let nodes move with a reference node as a rigid body: u = u0 + w × r, and w with it.

        Args:
            kind: kind of the coupling.
            name: its name.
            reference: the reference node, with displacement u0 and rotation w.
            nodes: the other nodes, at r from it.
            components: which of their components.
            x: coordinates of all nodes, shape (n, 3).
        """
        arms = x[nodes] - x[reference]
        arms[np.abs(arms) <= ROUNDING * np.ptp(x, axis=0).max()] = 0.0
        if components >= {0, 1, 2}:
            self.followers[reference] |= set(nodes.tolist()) - {reference}
        for node, arm in zip(nodes.tolist(), arms, strict=True):
            for k in components if node != reference else ():
                turns = [] if k > 2 else [(k + 1) % 3, (k + 2) % 3]
                turned = [(reference, 3 + one) for one in turns if arm[sum(turns) - one]]
                self.add(kind, name, [(node, k), (reference, k), *turned])

    def mean(self, kind: str, name: str, reference: int, nodes: Ints, weights: Floats) -> None:
        """Let a reference node follow the mean of nodes, which are as free as before.

        Args:
            kind: kind of the coupling.
            name: its name.
            reference: the reference node.
            nodes: the other nodes (k,).
            weights: weight of each (k,).
        """
        self.means[reference] = nodes, weights
        for k in range(3):
            self.add(kind, name, [(reference, k), *((int(node), k) for node in nodes)])

    def spread(
        self, forces: dict[int, Floats], x: Floats, body: set[int]
    ) -> tuple[dict[int, Floats], int]:
        """Give forces at the nodes of couplings instead of those at their reference nodes.

        A force F gives the nodes at r from their centroid, with weights w, the forces

            w (F / Σw + (T⁻¹ M) × r),    T = Σ w (r · r − r rᵀ),

        with its moment M about the centroid: those of RBE3 in Nastran without rotations of nodes.
        It stays where the nodes are too few to carry its moment.

        Args:
            forces: force (3,) at each node.
            x: coordinates of all nodes, shape (n, 3).
            body: the nodes of the body, at which forces stay.

        Returns:
            The forces, and how many of those given act on a rigid part.
        """
        found: dict[int, Floats] = defaultdict(lambda: np.zeros(3))
        rigid = 0
        for node, force in forces.items():
            nodes, weights = np.array([node]), np.ones(1)
            if node not in body and node in self.means:
                nodes, weights = self.means[node]
            elif node not in body and (reached := self._reached(node) & body):
                nodes, weights = np.array(sorted(reached)), np.ones(len(reached))
            arms = x[nodes] - weights @ x[nodes] / weights.sum()
            moment = np.cross(weights @ (x[node] - x[nodes]) / weights.sum(), force)
            inertia = np.einsum("i,ij,ik->jk", weights, arms, arms)
            turn = np.linalg.pinv(np.trace(inertia) * np.eye(3) - inertia, hermitian=True)
            parts = weights[:, None] * (force / weights.sum() + np.cross(turn @ moment, arms))
            lost = np.linalg.norm(np.cross(arms, parts).sum(axis=0) - moment)
            if lost > ROUNDING * np.linalg.norm(force) * np.ptp(x, axis=0).max():
                nodes, parts = np.array([node]), force[None, :]
            rigid += node not in self.means and node not in nodes
            for own, part in zip(nodes.tolist(), parts, strict=True):
                found[own] = found[own] + part
        return found, rigid

    def _reached(self, reference: int) -> set[int]:
        """The nodes that move with a reference node as one rigid body."""
        found, near = {reference}, {reference}
        while near:
            near = {n for node in near for n in self.followers.get(node, ())} - found
            found |= near
        return found

    def left(self, fixed: set[Component]) -> dict[str, int]:
        """The number of couplings of each kind that act on nodes that can move.

        A mean that its reference node follows freely acts on nothing.
        """
        names: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for k, (kind, name, terms) in enumerate(self.equations):
            if terms[0][0] not in self.means or terms[0] in fixed:
                names[kind].add((name, k if name == kind else 0))
        return {kind: len(of) for kind, of in names.items()}

    def solve(self, fixed: set[Component]) -> dict[str, dict[int, set[int]]]:
        """Hold what is the only component of an equation that is not held.

        Args:
            fixed: the components that are held, to which these are added.

        Returns:
            The components by name of the coupling and by node. The equations that hold nothing and
            do not hold of themselves remain.
        """
        found: dict[str, dict[int, set[int]]] = defaultdict(lambda: defaultdict(set))
        count = -1
        while len(self.equations) != count:
            count, left = len(self.equations), []
            for equation in self.equations:
                free = [term for term in equation.terms if term not in fixed]
                if len(free) > 1:
                    left.append(equation)
                    continue
                self.through |= {node for node, _ in equation.terms}
                for node, component in free:
                    found[equation.name][node].add(component)
                fixed.update(free)
            self.equations = left
        return found

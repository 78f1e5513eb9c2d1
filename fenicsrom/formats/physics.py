"""What a finite-element model holds besides its mesh, in the units of its file.

`Physics` names groups and gives coordinates, as a scene does.
"""

from __future__ import annotations

from dataclasses import dataclass

AXES = "xyz"
"""Names of the components 0, 1 and 2."""


def axes_of(components: set[int]) -> str:
    """The names of the displacements among some components, such as "xz" for 0, 2 and 4."""
    return "".join(AXES[k] for k in sorted(components & {0, 1, 2}))


@dataclass(frozen=True)
class DeckMaterial:
    """An isotropic elastic material.

    Attributes:
        name: its name in the file.
        young: Young's modulus.
        poisson: Poisson's ratio.
        density: density; None if the file has none.
        group: the group of its cells; None if all cells have it.
    """

    name: str
    young: float
    poisson: float
    density: float | None
    group: str | None = None


@dataclass(frozen=True)
class DeckLoad:
    """A static load: a force at a node, a pressure on a group, or an acceleration of the body.

    Attributes:
        kind: "force", "pressure" or "acceleration".
        vector: the force or acceleration (3,); the pressure in its first entry.
        point: coordinates of the node of a force.
        group: the group of facets under a pressure.
    """

    kind: str
    vector: tuple[float, ...]
    point: tuple[float, ...] | None = None
    group: str | None = None


@dataclass(frozen=True)
class Physics:
    """What a file holds besides the mesh.

    Attributes:
        materials: the materials of the cells.
        supports: components (0, 1, 2) that are held at each group of nodes or facets.
        masses: coordinates of a node and its mass.
        springs: coordinates of a node, component, and stiffness of its spring to the ground.
        loads: static loads.
        not_taken: what a scene cannot state, each in a few words.
    """

    materials: tuple[DeckMaterial, ...] = ()
    supports: tuple[tuple[str, tuple[int, ...]], ...] = ()
    masses: tuple[tuple[tuple[float, ...], float], ...] = ()
    springs: tuple[tuple[tuple[float, ...], int, float], ...] = ()
    loads: tuple[DeckLoad, ...] = ()
    not_taken: tuple[str, ...] = ()

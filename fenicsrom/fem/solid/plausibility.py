"""Materials, sizes and contact normals that are most likely mistakes.

Most mistakes are numbers in other units than SI. The speed of waves along a bar, sqrt(E / ρ), shows
them for all solids: it is 100 to 20,000 m/s from rubber to diamond, whatever the unit of E is.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import dolfinx.mesh
import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.fem.base.compat import cells_of, entity_nodes
from fenicsrom.notes import Note, implausible
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.scene import Region, Scene
from fenicsrom.scene.keys.unit_system import SYSTEMS, Units

if TYPE_CHECKING:
    from fenicsrom.fem.mesh.mesh import Mesh

WAVE_SPEEDS = (100.0, 20e3)
"""Speeds of waves along a bar of a solid, m/s: soft rubber, diamond."""

USUAL_SPEED = 4000.0
"""Of several units, the ones are likely whose speed is nearest to this one, m/s."""

YOUNG = (1e4, 2e12)
"""Young's moduli of solids, Pa: soft gel, more than diamond."""

DENSITIES = (1.0, 30e3)
"""Densities of solids, kg/m³: aerogel, more than osmium."""

EXTENTS = (1e-7, 200.0)
"""Lengths of bodies, m; a longer one is most likely given in mm."""

MODULI = {"MPa": 1e6, "GPa": 1e9}
PER_VOLUME = {"g/cm³": 1e3, "kg/mm³": 1e9, "t/mm³": 1e12}
"""Other units of one number."""

OPPOSITE = -0.5
"""A contact normal points into the body if its cosine with the outward normal is smaller."""

NEAR = 1e-6
"""Distance within which a node belongs to a facet, relative to the facet."""

LEAVES = 0.1
"""A direction leaves the body through a facet if its cosine with the outer normal is above this."""

MOST = 4
"""Points of a contact without facets that are judged."""


def implausible_inputs(scene: Scene, mesh: Mesh) -> list[Note]:
    """One sentence on the first material, or on the size, that is most likely a mistake.

    Args:
        scene: the scene.
        mesh: its mesh.
    """
    names = [("material", scene.material)]
    names += [(f"materials[{k}]", group) for k, group in enumerate(scene.materials)]
    for key, material in names:
        young, density = max(material.orthotropic_constants[0]), material.density
        if not _is_solid(young, density):
            text = (
                f"{key}.young = {young:.6g} Pa and {key}.density = {density:.6g} kg/m³ give "
                f"waves of {math.sqrt(young / density):.3g} m/s (most solids: {WAVE_SPEEDS[0]:g} "
                f"to {WAVE_SPEEDS[1]:g} m/s): {_likely_units(young, density, scene.units)}"
            )
            return [implausible(text)]
    extent = mesh.extent()
    if EXTENTS[0] <= extent <= EXTENTS[1]:
        return []
    what = "coordinates in mm? Then give [units], or geometry.scale = 0.001 for a mesh file"
    likely = f": are the {what}" if extent > EXTENTS[1] else ": check geometry.scale and [units]"
    return [implausible(f"the body is {extent:.4g} m long{likely}")]


def _likely_units(young: float, density: float, given_in: Units) -> str:
    """The units in which these numbers are those of a solid: of one of them, else of both.

    Args:
        young: Young's modulus, Pa.
        density: density, kg/m³.
        given_in: the units of the scene, which may be wrong.
    """
    units = "or the units of all numbers in [units]"
    found: list[tuple[float, str]] = []

    def consider(modulus: float, mass: float, words: str) -> None:
        if _is_solid(young * modulus, density * mass, usual=True):
            speed = math.sqrt(young * modulus / (density * mass))
            found.append((abs(math.log(speed / USUAL_SPEED)), words))

    for unit, factor in MODULI.items():
        given = f"Give {young * factor:.6g} Pa, {units}"
        consider(factor, 1.0, f"is Young's modulus in {unit}? {given}")
    for unit, factor in PER_VOLUME.items():
        given = f"Give {density * factor:.6g} kg/m³, {units}"
        consider(1.0, factor, f"is the density in {unit}? {given}")
    if not found:
        for system in SYSTEMS:
            length, mass, time = system.length, system.mass, system.time
            given = f'[units] length = "{length}", mass = "{mass}", time = "{time}"'
            words = f"are the units {length}, {mass} and {time}? Give {given}"
            scales = [system.factor(unit) / given_in.factor(unit) for unit in ("Pa", "kg/m³")]
            consider(float(scales[0]), float(scales[1]), words)
    return min(found)[1] if found else "all numbers are in SI units, or in those of [units]"


def _is_solid(young: float, density: float, usual: bool = False) -> bool:
    """Whether a solid may have this modulus in Pa and density in kg/m³.

    Args:
        young: Young's modulus.
        density: the density.
        usual: whether it shall be a solid that machines are made of, from rubber to ceramics.
    """
    moduli, densities = ((1e6, 1e12), (100.0, 25e3)) if usual else (YOUNG, DENSITIES)
    return (
        moduli[0] <= young <= moduli[1]
        and densities[0] <= density <= densities[1]
        and WAVE_SPEEDS[0] <= math.sqrt(young / density) <= WAVE_SPEEDS[1]
    )


def implausible_normals(scene: Scene, mesh: Mesh, points: ContactPoints) -> list[Note]:
    """One sentence on the first contact whose surface is on the side of the body. Collective.

    Stops on both sides of one place are not judged.

    Args:
        scene: the scene.
        mesh: its mesh.
        points: its contact points.
    """
    normals = [
        points.frame[points.contact == k, 0].mean(axis=0) for k in range(len(scene.contacts))
    ]
    for k, (contact, normal) in enumerate(zip(scene.contacts, normals, strict=True)):
        others = zip(scene.contacts, normals, strict=True)
        between = any(o.place == contact.place and n @ normal < 0.0 for o, n in others)
        if between or contact.against:
            continue
        if _enters(mesh, contact.place, points.position[points.contact == k][:MOST], normal):
            name = "normal" if contact.surface is None else "surface"
            words = ", ".join(f"{x + 0.0:.3g}" for x in normal)
            text = (
                f"contacts[{k}].{name}: the direction into the surface, ({words}), "
                "points into the body where they touch: turn it round, so that the surface lies "
                "outside of the body"
            )
            return [implausible(text)]
    return []


def _enters(mesh: Mesh, region: Region, at: Array, direction: Array) -> bool:
    """Whether a direction (d,) enters the body at a region. Collective.

    It does if it enters through a facet of the boundary and leaves through none. The facets are
    those of the region, or those at nodes (k, d) of a region without facets. A node inside of the
    body, or at the middle of a curved edge, has no such facet.
    """
    domain, d = mesh.domain, mesh.domain.topology.dim
    domain.topology.create_connectivity(d - 1, d)
    facets = dolfinx.mesh.exterior_facet_indices(domain.topology)
    if mesh.has_facets(region):
        facets = np.intersect1d(facets, mesh.facets(region))
    corners, normals = _facets(mesh, facets)
    if not mesh.has_facets(region):
        places = (corners[:, :, None] + corners[:, None])[..., None, :d] / 2.0
        away = np.linalg.norm(places - at, axis=4).min(axis=(1, 2, 3), initial=np.inf)
        normals = normals[away <= NEAR * np.linalg.norm(np.ptp(corners, axis=1), axis=1)]
    sizes = np.linalg.norm(normals, axis=1) * np.linalg.norm(direction)
    every = np.concatenate(domain.comm.allgather(normals[:, :d] @ direction / sizes))
    return bool(every.size and every.min() < OPPOSITE and every.max() < LEAVES)


def _facets(mesh: Mesh, facets: Array) -> tuple[Array, Array]:
    """Corners (k, c, 3) of boundary facets, and their outer normals (k, 3) of twice their area."""
    domain, d = mesh.domain, mesh.domain.topology.dim
    cells, x = domain.topology.connectivity(d - 1, d), domain.geometry.x
    corners = x[entity_nodes(domain, d - 1, facets)]
    _, nodes = cells_of(domain.geometry)
    middle = x[nodes[cells.array[cells.offsets[facets]]]].mean(axis=1)
    across = corners[:, 2] - corners[:, 0] if d == 3 else np.array([0.0, 0.0, 1.0])
    normals = np.cross(corners[:, 1] - corners[:, 0], across)
    normals *= np.sign(np.sum(normals * (corners.mean(axis=1) - middle), axis=1))[:, None]
    return corners, normals

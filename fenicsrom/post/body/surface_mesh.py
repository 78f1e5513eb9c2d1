"""Meshes of the rigid surfaces of a scene: walls, casings and balls, as they move."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import surface_turn
from fenicsrom.post.paraview.vtk import Attached, Grid, linear_grid, write_instants, write_vtu
from fenicsrom.scene import Scene

AROUND = 360  # edges around a cylinder: the polygon is 4e-5 of the radius off the circle
ALONG = 4  # edges along the axis of a cylinder and across a plane
MARGIN = 0.1  # extent of a cylinder beyond the paths of the contact points, relative to the paths
BEYOND = 0.05  # extent of a plane beyond these paths, relative to the distance of the points from 0


def write_surfaces(
    folder: Path, scene: Scene, points: ContactPoints, times: Array, moved: Array | None = None
) -> list[Path]:
    """Write each rigid surface of a contact as its own mesh, one file per instant.

    A surface that does not move has one file. Each surface is so large that the contact points do
    not leave it.

    Args:
        folder: the folder to write to.
        scene: the scene.
        points: its contact points.
        times: (k,) instants, s.
        moved: (n, P, d) displacements of the contact points in their frames, m; None at rest.

    Returns:
        The `.pvd` files, `surface_1/surface_1.pvd` and so on.

    Raises:
        OSError: a file cannot be written; no partial file remains.
    """
    return [
        write_instants(folder / f"surface_{k + 1}", times, _writer(scene, points, k, times, moved))
        for k, contact in enumerate(scene.contacts)
        if contact.against is None
    ]


def _writer(
    scene: Scene, points: ContactPoints, k: int, times: Array, moved: Array | None
) -> Callable[[Path, int], str]:
    """What writes the surface of contact k at an instant, by its number, into a folder."""
    contact, notes = scene.contacts[k], {"contact": f"contacts[{k}]", "unit of length": "m"}
    moving = bool(contact.approach) or bool(contact.surface and contact.surface.waves)

    def write(folder: Path, number: int) -> str:
        file = f"surface_{k + 1}_{number if moving else 0:05d}.vtu"
        if not (folder / file).exists():
            grid = surface_grid(scene, points, k, float(times[number]), moved)
            write_vtu(folder / file, grid, Attached(notes=notes))
        return file

    return write


def surface_grid(
    scene: Scene, points: ContactPoints, k: int, time: float, moved: Array | None = None
) -> Grid:
    """The part of the surface of contact k that its points pass, at an instant (s).

    Argument `moved` as for `write_surfaces`.
    """
    places = _surface(scene, points, k, time, moved)
    number = np.arange(places[..., 0].size).reshape(places.shape[:-1])
    corners = [number[:-1], number[1:]]
    if places.ndim == 3:
        corners = [part for end in corners for part in (end[:, :-1], end[:, 1:])]
    cells = np.stack(corners, axis=-1).reshape(-1, len(corners))
    return linear_grid(places.reshape(-1, places.shape[-1]), cells, places.ndim - 1)


def _surface(
    scene: Scene, points: ContactPoints, k: int, time: float, moved: Array | None = None
) -> Array:
    """The points (n, 2) of a line or (n, l, 3) of a sheet; arguments as `surface_grid`."""
    mine = np.flatnonzero(points.contact == k)
    contacts = contacts_of(scene, points)
    p = int(mine[0])
    position, d = points.position[mine], points.position.shape[1]
    path = position[None]
    if moved is not None:
        path = path + np.einsum("npk,pkx->npx", moved[:, mine], points.frame[mine])
    approach = contacts.approach[p]
    closed = float(np.interp(time, contacts.times, approach)) if approach.size else 0.0
    surface = scene.contacts[k].surface
    if surface is None:
        distance = contacts.radius[p] - closed
        return _plane(position, path, points.frame[p], distance)
    centre, side, radius = np.array(surface.point), contacts.side[p], contacts.radius[p]
    across = contacts.axes[p, : contacts.kind[p]] @ points.frame[p]
    if across.shape[0] == 3:
        return _ball(centre, radius - side * closed)
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    turned = surface_turn(contacts, p, 0.0, time)
    waves = np.zeros_like(angle)
    for order, height, phase in surface.waves:
        waves += height * np.cos(order * (angle - turned) - phase)
    size = radius - side * (closed + waves)
    ring = size[:, None] * (np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1])
    if d == 2:
        return np.asarray(centre + ring)
    axis = np.cross(across[0], across[1])
    heights = (path - centre) @ axis
    spare = MARGIN * max(float(np.ptp(heights)), float(radius) * MARGIN)
    levels = np.linspace(heights.min() - spare, heights.max() + spare, ALONG + 1)
    return np.asarray(centre + ring[:, None] + levels[None, :, None] * axis)


def _plane(position: Array, path: Array, frame: Array, distance: float) -> Array:
    """Points (n, 2) or (n, l, 3) of a plane at a distance along the normal from points (p, d).

    It is wider than their path (n, p, d).
    """
    centre = position.mean(axis=0) + distance * frame[0]
    tangents = frame[1:]
    reach = np.abs((path - position.mean(axis=0)) @ tangents.T).max(axis=(0, 1))
    half = reach + (BEYOND * float(np.linalg.norm(position, axis=1).max()) or 1.0)
    steps = np.meshgrid(*(np.linspace(-size, size, ALONG + 1) for size in half), indexing="ij")
    return np.asarray(centre + np.stack(steps, axis=-1) @ tangents)


def _ball(centre: Array, radius: float) -> Array:
    """Points (n, l, 3) of a sphere, by longitude and latitude."""
    longitude = np.linspace(0.0, 2.0 * np.pi, AROUND // 4 + 1)
    latitude = np.linspace(0.0, np.pi, AROUND // 8 + 1)
    turn, tilt = np.meshgrid(longitude, latitude, indexing="ij")
    ways = [np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)]
    return np.asarray(centre + radius * np.stack(ways, axis=-1))

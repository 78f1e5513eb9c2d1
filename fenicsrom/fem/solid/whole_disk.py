"""All sectors of a disk as one scene, for the full model of a scene with [cyclic].

Sector j is sector 0 turned by j 360°/N about the axis, and so are its loads, contacts, supports and
attachments; the phases of engine orders are those of `fenicsrom.online.model.disk_model`. The mesh
comes from `build_mesh` with the table [cyclic]. A contact between regions is one contact of all
sectors, in which the closest facets of the other regions lie opposite.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from fenicsrom.arrays import Array
from fenicsrom.fem.mesh.gmsh_parts import sector_turn
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.fem.solid.wave import wave
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.model.disk_model import deviations, disk_scene
from fenicsrom.online.motion.motion import Motion
from fenicsrom.reduction.damping import ViscousDamping
from fenicsrom.scene import Cyclic, Region, Scene
from fenicsrom.scene.base.rules import Problem, Problems, Where
from fenicsrom.scene.base.tables import plain, require_none
from fenicsrom.scene.checks.checks import regions
from fenicsrom.scene.keys.places import AXES, Elasticity, GroupMaterial

RegionType = TypeVar("RegionType", bound=Region)

SHIFTED = 1e-6
"""Components are those of the turned frame up to this rounding."""


class _Turn:
    """The turn of sector 0 to sector j."""

    def __init__(self, cyclic: Cyclic, j: int):
        """Take the angle j 360°/N about the axis."""
        self._j, d = j, len(cyclic.point or ())
        self.matrix: Array = sector_turn(cyclic, j).as_matrix()[:d, :d]
        self._point = np.array(cyclic.point)

    def moved(self, points: Array) -> Array:
        """Points (n, d) of sector j."""
        return np.asarray(self._point + (points - self._point) @ self.matrix.T)

    def of(self, table: Any) -> Any:
        """A table of sector j: its groups, places and directions, in the tables inside it, too."""
        found: dict[str, Any] = {}
        if isinstance(table, Region):
            table = named(table)
        for name in (entry.name for entry in fields(table)):
            value = getattr(table, name)
            if is_dataclass(value):
                found[name] = self.of(value)
            elif name == "group" and value is not None:
                found[name] = f"{value}@{self._j}"
            elif name in ("node", "nearest") and value is not None:
                found[name] = tuple(self.moved(np.array([value]))[0].tolist())
            elif name in ("direction", "normal", "axes") and value is not None:
                turned = np.array(value) @ self.matrix.T
                found[name] = tuple(map(tuple, turned.tolist()) if turned.ndim > 1 else turned)
        return replace(table, **found)


def named(region: RegionType) -> RegionType:
    """A region, with a group in place of a box or a plane."""
    pick = region.box or region.plane
    return replace(region, box=None, plane=None, group=str(pick)) if pick else region


def picks(scene: Scene) -> dict[str, Region]:
    """The boxes and planes of a scene, by the names of their groups in the whole disk."""
    return {
        str(named(region).group): region
        for _, region in regions(scene)
        if region.box or region.plane
    }


def whole_scene(scene: Scene) -> Scene:
    """The scene of the whole disk.

    Args:
        scene: a scene with the table [cyclic].

    Raises:
        SceneError: it has what cannot be copied to other sectors.
    """
    require_none(_problems(scene), scene, Where(scene.source))
    assert scene.cyclic is not None
    turns = [_Turn(scene.cyclic, j) for j in range(scene.cyclic.sectors)]
    count, loads = len(scene.loads), []
    for k, load in enumerate(disk_scene(scene).loads):  # one sector after the other
        if k < count or not load.everywhere:
            loads.append(turns[k // count].of(load))
    contacts = []
    for j, k in _contacts(scene):
        contact = scene.contacts[k]
        if contact.against:
            contact = replace(contact, place=named(contact.place), against=named(contact.other))
        contacts.append(contact if contact.against else turns[j].of(contact))
    return replace(
        scene,
        cyclic=None,
        loads=tuple(loads),
        contacts=tuple(replace(contact, neighbour=False) for contact in contacts),
        supports=tuple(turn.of(one) for turn in turns for one in scene.supports),
        attachments=tuple(turn.of(one) for turn in turns for one in scene.attachments),
        materials=tuple(_materials(scene, turns)),
        probe=scene.probe and turns[0].of(scene.probe),
    )


def _materials(scene: Scene, turns: list[_Turn]) -> list[GroupMaterial]:
    """The materials of all sectors, with turned axes and mistuned moduli, if sectors differ."""
    delta, every = deviations(scene), (scene.material, *scene.materials)
    if not delta.any() and all(one.is_isotropic for one in every):
        return list(scene.materials)
    d, constants = scene.geometry.dimension, [entry.name for entry in fields(Elasticity)]
    given = {name: getattr(scene.material, name) for name in constants}
    found = []
    for one in (GroupMaterial(group="", **given), *scene.materials):
        whole = replace(one, axes=one.axes or tuple(map(tuple, np.eye(d - 1, d).tolist())))
        for turn, change in zip(turns, delta, strict=True):
            young, shear = (_scaled(modulus, 1.0 + change) for modulus in (one.young, one.shear))
            found.append(replace(turn.of(whole), young=young, shear=shear))
    return found


def _scaled(modulus: Any, factor: float) -> Any:
    """A modulus, or each of several, times a factor; None stays None."""
    if isinstance(modulus, tuple):
        return tuple(factor * value for value in modulus)
    return modulus and factor * modulus


def _contacts(scene: Scene) -> list[tuple[int, int]]:
    """The sector and the number in the scene of a sector of each contact of the whole disk."""
    assert scene.cyclic is not None
    every = [(j, k) for j in range(scene.cyclic.sectors) for k in range(len(scene.contacts))]
    return [(j, k) for j, k in every if j == 0 or scene.contacts[k].against is None]


def _problems(scene: Scene) -> Problems:
    """Yield what cannot be copied to other sectors."""
    cyclic, what = scene.cyclic, "in the whole disk of fenicsrom compare"
    assert cyclic is not None
    matrix = _Turn(cyclic, 1).matrix
    for table in ("supports", "attachments"):
        for k, one in enumerate(getattr(scene, table)):
            held = np.diag([name in (one.components or AXES) for name in AXES[: len(matrix)]])
            if np.abs(matrix @ held @ matrix.T - held).max() > SHIFTED:
                allowed = f"must be all, that along the axis, or the other ones {what}"
                yield Problem(f"{table}[{k}].components", allowed)
    unusual: dict[str, object] = {
        "damping.ratios": scene.joined and any(scene.damping.modal) and scene.damping.ratios,
        **{f"loads[{k}].engine_order": x.everywhere and x.order for k, x in enumerate(scene.loads)},
    }
    for key in filter(unusual.get, unusual):
        reason = " with contacts.against" if key == "damping.ratios" else ""
        yield Problem(key, f"not allowed{reason} {what}", value=plain(unusual[key]))


def damp_waves(body: Solid, sector: Solid, scene: Scene) -> None:
    """Give the whole disk the modal damping of its waves. Collective.

    Args:
        body: the whole disk.
        sector: the sector in its equilibrium, without contacts between bodies.
        scene: the scene of the sector.
    """
    cyclic, cut, ratios = scene.cyclic, sector.cut, np.array(scene.damping.modal)
    assert cyclic is not None and cut is not None
    if not ratios.any():
        return
    n, d, comm = cyclic.sectors, sector.dimension, body.comm
    places, nodes = (
        one.space.tabulate_dof_coordinates()[: one.local // d, :d] for one in (sector, body)
    )
    places = np.concatenate(comm.allgather(places))
    turns = [_Turn(cyclic, j) for j in range(n)]
    near = cKDTree(np.concatenate([turn.moved(places) for turn in turns])).query(nodes)[1]
    j, node = np.divmod(near, len(places))
    turned = np.array([turn.matrix for turn in turns])[j]
    zeta, squares, modes = [], [], []
    for h in range(n // 2 + 1):
        with wave(sector, h) as one:
            copies = 2 if one.double else 1  # the real and the imaginary part of a wave
            found, z = one.eigenmodes(one.factor, copies * len(ratios))
            u = copies * cut.displacements(h, one.parts(z)[0]).reshape(-1, d, z.shape[1])
        u = np.concatenate(comm.allgather(u))
        lag = np.exp(2j * np.pi * h / n * j)[:, None, None]
        moved = np.real(lag * np.einsum("nij,njk->nik", turned, u[node]))
        modes.append(np.sqrt(copies / n) * moved.reshape(body.local, -1))
        zeta.append(np.repeat(ratios, copies))
        squares.append(found)
    body.viscous = ViscousDamping(body, replace(scene.damping, ratios=()), body.dashpots)
    body.viscous.damp(np.concatenate(zeta), np.concatenate(squares), np.concatenate(modes, axis=1))


def as_sectors(motion: Motion, body: Solid, points: ContactPoints, scene: Scene) -> Motion:
    """The motion of the whole disk in the order and in the frames of the contact points of sectors.

    Args:
        motion: the motion.
        body: the whole disk.
        points: (P,) the points of sector 0.
        scene: the scene of a sector.

    Returns:
        The motion, without what an integration could continue.
    """
    if not scene.contacts:
        return motion
    cyclic, own = scene.cyclic, body.points
    assert cyclic is not None
    number = np.array([k for _, k in _contacts(scene)])[own.contact]
    every = cyclic.sectors, len(points.contact)
    order, frames = np.empty(every, dtype=np.int64), np.empty((*every, *points.frame.shape[1:]))
    for k in np.unique(points.contact):
        at, there = np.flatnonzero(points.contact == k), np.flatnonzero(number == k)
        near, side = cKDTree(own.position[there]), _first_side(body, points, scene, k)
        for j in range(cyclic.sectors):
            turn = _Turn(cyclic, j + side)
            order[j, at] = there[near.query(turn.moved(points.position[at]))[1]]
            frames[j, at] = points.frame[at] @ turn.matrix.T
    order, frames = order.ravel(), frames.reshape(-1, *points.frame.shape[1:])
    turned = frames @ own.frame[order].transpose(0, 2, 1)
    seen = {
        name: np.einsum("pij,...pj->...pi", turned, getattr(motion, name)[..., order, :])
        for name in ("displacement", "force", "mean_force")
    }
    for name in ("gap", "state", "point_friction_dissipation"):
        seen[name] = getattr(motion, name)[:, order]
    return replace(motion, end=None, **seen)


def _first_side(body: Solid, points: ContactPoints, scene: Scene, k: int) -> int:
    """1 if the first region of contact k between sectors j and j + 1 is that of j + 1, else 0."""
    contact, cyclic = scene.contacts[k], scene.cyclic
    assert cyclic is not None
    if not contact.neighbour:
        return 0
    against = named(contact.other).group
    x = body.space.tabulate_dof_coordinates()[:, : body.dimension]
    middle = points.position[points.contact == k].mean(axis=0)
    away = [
        np.linalg.norm(x[body.mesh.nodes(f"{against}@{j}", body.space)].mean(0) - middle)
        for j in (1, cyclic.sectors - 1)
    ]
    return int(away[1] < away[0])

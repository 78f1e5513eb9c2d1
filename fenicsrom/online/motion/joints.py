"""What a contact between bodies does as a whole: its force, its moment and what it dissipates."""

from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints, contacts_of, trial_forces
from fenicsrom.online.motion.measures import point_summaries
from fenicsrom.online.motion.motion import Motion


class Joint(NamedTuple):
    """A contact between bodies in a motion.

    Attributes:
        contact: its number in the scene.
        places: (p, d) its points on the undeformed body, m.
        area: (p,) of each point, m².
        centre: (d,) their centroid, about which the moments are taken, m.
        pressure: (p,) in the equilibrium, Pa.
        shares: name of a state -> part (p,) of the last period in it.
        dissipation: (p,) energy that friction dissipates in the last period (or in all) by area,
            J/m².
        force: (ns, d) on the first region, in global axes, N.
        moment: (ns, 1) about z in 2D, or (ns, 3), N m.
        spent: (ns,) energy that friction has dissipated since the start, J.
    """

    contact: int
    places: Array
    area: Array
    centre: Array
    pressure: Array
    shares: dict[str, Array]
    dissipation: Array
    force: Array
    moment: Array
    spent: Array

    @property
    def columns(self) -> dict[str, Array]:
        """The components (ns,) of force and moment by their names, with units."""
        d = self.force.shape[1]
        names = [f"force_{axis}_N" for axis in "xyz"[:d]]
        names += [f"moment_{axis}_Nm" for axis in ("z" if d == 2 else "xyz")]
        return dict(zip(names, np.concatenate([self.force, self.moment], axis=1).T, strict=True))


def contact_maps(motion: Motion, points: ContactPoints) -> dict[str, Array]:
    """Parts (P,) of the last period in each state, and the dissipated energy by area, J/m²."""
    summaries = point_summaries(motion)
    spent = [point["friction_dissipation_per_period_J"] for point in summaries]
    names = summaries[0]["fraction"] if summaries else ()
    return {
        "friction_J_per_m2": np.array(spent) / points.tributary_area,
        **{f"part_{s}": np.array([point["fraction"][s] for point in summaries]) for s in names},
    }


def joints_of(motion: Motion, scene: Any, points: ContactPoints, at_rest: Array) -> list[Joint]:
    """The contacts between bodies in a motion.

    Args:
        motion: the motion.
        scene: its scene.
        points: the contact points.
        at_rest: (m,) contact displacements in the equilibrium, m.
    """
    maps, found = contact_maps(motion, points), []
    pressed = trial_forces(contacts_of(scene, points), at_rest).clip(0.0) / points.tributary_area
    for k, contact in enumerate(scene.contacts):
        if contact.against is None:
            continue
        mine = np.flatnonzero(points.contact == k)
        area, places = points.tributary_area[mine], points.position[mine]
        centre = np.average(places, axis=0, weights=area)
        force = -np.einsum("spi,pix->spx", motion.force[:, mine], points.frame[mine])
        wide = (0, 0), (0, 0), (0, 3 - force.shape[2])
        arms: Array = np.pad((places - centre)[None], wide)
        pushed: Array = np.pad(force, wide)
        turned = np.cross(arms, pushed)
        states = {
            name.removeprefix("part_"): part[mine]
            for name, part in maps.items()
            if name.startswith("part_")
        }
        found.append(
            Joint(
                contact=k,
                places=places,
                area=area,
                centre=centre,
                pressure=pressed[mine],
                shares=states,
                dissipation=maps["friction_J_per_m2"][mine],
                force=force.sum(axis=1),
                moment=turned.sum(axis=1)[:, 2 if force.shape[2] == 2 else 0 :],
                spent=motion.point_friction_dissipation[:, mine].sum(axis=1),
            )
        )
    return found

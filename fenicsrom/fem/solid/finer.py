"""The solid with elements of one degree more, which judges the mesh.

The displacements of the elements of degree p are among those of degree p + 1 on the same cells, so
the second are better on any mesh (Babuska, Szabo and Katz, SIAM J. Numer. Anal. 18, 1981). Loads,
contact points and probe stay where the solid has them: with the displacements J u of the finer
solid at the nodes of the solid,

    load vector  Jᵀ p,    contact rows  Bᵀ J,    probe rows  L J.    (1)

Body forces and follower pressures are assembled on the finer elements.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from dolfinx import fem
from dolfinx.fem.petsc import interpolation_matrix
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.scene import Attachment, Contact, Place, Scene

LARGEST = 60_000
"""Largest number of unknowns of the finer elements: one factorisation of some ten seconds."""


def too_large(solid: Solid) -> str | None:
    """The reason why a solid is too large for an estimate of its mesh error, or None."""
    degree, d = solid.geometry.degree, solid.dimension
    growth = ((degree + 1) / degree) ** d
    if growth * solid.size <= LARGEST:
        return None
    return (
        f"with elements of degree {degree + 1} the body would have about "
        f"{growth * solid.size:.2g} unknowns (at most {LARGEST:g} are used); run once with half as "
        "many cells in each direction to see what the mesh costs"
    )


def _nearest(place: Place) -> Place:
    """The node nearest to that of the scene, in place of it."""
    return replace(place, node=None, nearest=place.node) if place.node else place


class FinerSolid(Solid):
    """A solid with elements of one degree more than a coarser one, and with its places."""

    def __init__(self, scene: Scene, coarser: Solid):
        """Build the solid of a scene on the mesh of a coarser solid; errors as `Solid`."""
        self._coarser = coarser
        geometry = replace(scene.geometry, degree=scene.geometry.degree + 1)
        super().__init__(coarser.mesh, replace(scene, geometry=geometry))

    def lifted(self, block: Array) -> Array:
        """Jᵀ f: the forces (local, k) of forces (local of the coarser solid, k)."""
        at, to = self._restriction.createVecLeft(), self._restriction.createVecRight()
        found = np.zeros((self.local, block.shape[1]))
        for k in range(block.shape[1]):
            at.array[:] = block[:, k]
            self._restriction.multTranspose(at, to)
            found[:, k] = to.array
        at.destroy()
        to.destroy()
        return self.without_held(found)

    def destroy(self) -> None:
        """Free the matrices and the factor. Collective."""
        self._restriction.destroy()
        super().destroy()

    def _set_attachments(self, attachments: Sequence[Attachment]) -> None:
        """Set the springs, dashpots and masses; a node is that nearest to the one of the scene."""
        super()._set_attachments(
            [
                replace(found, place=_nearest(found.place), to=found.to and _nearest(found.to))
                for found in attachments
            ]
        )

    def _predicted(self) -> Array | None:
        """The equilibrium of the coarser solid, whose displacements are those of both solids."""
        if not self.symmetric or self._coarser.unstable:
            return super()._predicted()
        coarse, fine = fem.Function(self._coarser.space), fem.Function(self.space)
        self._coarser.set_field(coarse, self._coarser.equilibrium)
        fine.interpolate(coarse)
        return self.without_held(fine.x.array[: self.local].copy())

    def _set_contacts(self, contacts: Sequence[Contact]) -> None:
        """Take the contact points of the coarser solid."""
        self._restriction = interpolation_matrix(self.space, self._coarser.space)
        self._restriction.assemble()
        self.points, self.interface = self._coarser.points, self._coarser.interface
        self.pairs: list[str] = []
        self.between = self._coarser.between
        self.contact_rows, self.ahead_rows = (
            csr_array(self.lifted(rows.toarray().T).T)
            for rows in (self._coarser.contact_rows, self._coarser.ahead_rows)
        )

    def _assembled_loads(self) -> Array:
        """Take the loads at places of the coarser solid, and assemble the others."""
        vectors = self.lifted(self._coarser.load_vectors)
        for k, load in enumerate(self.loads):
            if load.everywhere or load.follower:
                vectors[:, k] = self.load_vector(load, f"loads[{k}]")
        return vectors

    def _set_probe(self, scene: Scene) -> None:
        """Take the probe of the coarser solid."""
        self.probe_rows = self.lifted(self._coarser.probe_rows.T).T
        self.probe_position = self._coarser.probe_position

"""A disk of reduced sectors as a file holds it, which moves under other scenes without its mesh."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from fenicsrom.notes import Note, NoteKind, unpacked
from fenicsrom.online.model.disk_model import Sector, load_diameters, require_families
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.scene_changes import Trained, UnderScenes, require_same_model
from fenicsrom.online.stress.stress import StressTable
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.rotation_checks import require_disk_run
from fenicsrom.scene.keys.excitation import highest_frequency
from fenicsrom.words import brief, counted

SLACK = 1.001
"""A frequency that is higher by a smaller factor is the same one."""


@brief("scene", "sentence", "dofs", "diameters", "file")
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StoredDisk(UnderScenes):
    """A reduced sector with its scene.

    Attributes:
        sector: the sector.
        larger: a sector with more waves and modes, which judges it.
        scene: the scene from which it was made, or under which its disk moves.
        dofs: number of free unknowns of the sector.
        extent: its largest extent, m.
        diameters: the nodal diameters that shape its cut faces.
        wave_error: a nodal diameter, and the relative error of its frequencies by the reduction.
        highest_hz: the highest frequency for which the modes were chosen.
        sentence: what was found of the cut faces.
        table: the stresses and displacements of the sector by its coordinates; None if the scene
            asks for neither.
        notes: notes on the sector, as `fenicsrom.notes.packed` gives them.
        trained: what the motion holds that chose the interface vectors; None without such vectors.
        provenance: versions of the programs that made it, by name.
        file: the file from which it was read, for messages; "" if there is none.
    """

    sector: Sector
    larger: Sector
    scene: Scene
    dofs: int
    extent: float
    diameters: tuple[int, ...]
    wave_error: tuple[int, float]
    highest_hz: float
    sentence: str
    table: StressTable | None = None
    notes: list[list[str]] = field(default_factory=list)
    trained: Trained | None = None
    provenance: dict[str, str] = field(default_factory=dict)
    file: str = ""

    @property
    def model(self) -> ReducedModel:
        """The linear model of the sector, whose cut faces are free."""
        return self.sector.model

    @property
    def size(self) -> int:
        """Number of coordinates of the sector, those of the following face left out."""
        return self.model.size - self.sector.shapes

    @property
    def chosen(self) -> list[int]:
        """The sectors whose stresses and displacements are wanted."""
        wanted, cyclic = self.scene.output.sectors, self.scene.cyclic
        assert cyclic is not None
        return [*range(cyclic.sectors)] if isinstance(wanted, str) else sorted(set(wanted))

    def _with_scene(self, scene: Scene, source: str) -> StoredDisk:
        require_same_model(self.scene, scene, source)
        require_disk_run(scene)
        require_families(self.sector, scene)
        damping, histories = float(scene.material.mass_damping), load_histories(scene)
        changes: dict[str, Any] = {"damping": damping, "load_histories": histories}
        sector, larger = (
            each._replace(model=each.model._replace(**changes))
            for each in (self.sector, self.larger)
        )
        return replace(self, scene=scene, sector=sector, larger=larger)

    @property
    def warnings(self) -> list[Note]:
        """Notes on the sector, and on loads for which it was not made."""
        found = unpacked(self.notes)
        if other := sorted(load_diameters(self.scene) - set(self.diameters)):
            text = f"the sector was not made for waves with {counted(other[0], 'nodal diameter')}: "
            text += "run the scene again, without --from, to judge their frequencies"
            found.append(Note(NoteKind.UNCHECKED, text, "loads"))
        if highest_frequency(self.scene) > SLACK * self.highest_hz:
            text = f"the modes of the sector were chosen for loads up to {self.highest_hz:.4g} Hz: "
            text += "run the scene again, without --from"
            found.append(Note(NoteKind.BASIS, text, "loads"))
        return found

"""Write beam.op4: a beam as another program would hand it over, reduced to a few coordinates.

The beam of slip_liftoff_2d.toml, 20 planar Timoshenko elements, is reduced by the method of Craig
and Bampton: 4 interface coordinates (both displacements of the section at 0.7 of the length and of
the tip) and 5 modes with these held. rub.toml names the interface coordinates.
"""

from pathlib import Path

import numpy as np
import scipy.linalg

from fenicsrom.exchange.op4 import write_op4
from fenicsrom.reduction.beam import TimoshenkoBeam
from fenicsrom.scene import BeamSection, Material

SECTION = BeamSection(length=2.54, height=0.0254, width=0.0254, elements=20, load_at=0.7)
STEEL = Material(young=207e9, poisson=0.28, density=7801.0)
MODES = 5


def full_beam() -> TimoshenkoBeam:
    """The beam of 60 unknowns."""
    return TimoshenkoBeam(SECTION, STEEL, linear=True)


def craig_bampton(beam: TimoshenkoBeam) -> dict[str, np.ndarray]:
    """Mass and stiffness of the reduced beam, by their names in Nastran."""
    nodes = (beam.load_node, beam.tip_node)
    held = [beam.unknown(node, component) for node in nodes for component in (0, 1)]
    inner = np.setdiff1d(np.arange(len(beam.mass)), held)
    stiffness = beam.stiffness[np.ix_(inner, inner)]
    modes = scipy.linalg.eigh(stiffness, beam.mass[np.ix_(inner, inner)])[1][:, :MODES]
    basis = np.zeros((len(beam.mass), len(held) + MODES))
    basis[held, range(len(held))] = 1.0
    basis[inner, : len(held)] = -np.linalg.solve(stiffness, beam.stiffness[np.ix_(inner, held)])
    basis[inner, len(held) :] = modes
    return {"KAAX": basis.T @ beam.stiffness @ basis, "MAAX": basis.T @ beam.mass @ basis}


if __name__ == "__main__":
    write_op4(Path(__file__).with_name("beam.op4"), craig_bampton(full_beam()))

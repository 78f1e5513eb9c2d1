"""Whether the 1D beam of a scene stands for its solid: a comparison of linear properties.

The table [reference.beam_section] repeats what the mesh and the places of the scene say. If one of
them changes and the other does not, the beam is another structure. The first natural frequency and
the displacements at the loads and at the observed place then differ between beam and solid.
"""

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.reduction.beam import beam_structure
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Scene

AGREEMENT = 0.05
"""Largest relative difference; a slender solid on a usual mesh is within 1 %."""


def check_beam(body: Structure, scene: Scene) -> None:
    """Check that the beam of a scene agrees with its solid. Collective.

    Args:
        body: the solid.
        scene: its scene, with a reference beam.

    Raises:
        SceneError: the beam differs from the solid, or cannot be made of this scene.
    """
    ours, theirs = _properties(body), _properties(beam_structure(scene))
    for name, value in ours.items():
        apart = float(np.linalg.norm(value - theirs[name]))
        if apart > AGREEMENT * float(np.linalg.norm(value)):
            reason = (
                f"the beam does not stand for the solid: {name} is {_shown(theirs[name])} of the "
                f"beam and {_shown(value)} of the solid (at most {100.0 * AGREEMENT:g} % "
                "difference is accepted); give the length, height, width and load_at of the mesh, "
                "or set reference.beam = false"
            )
            raise refuse(scene.source, reason, ErrorKind.MISMATCH, "reference.beam_section")


def _shown(values: Array) -> str:
    """Numbers for a message."""
    return ", ".join(f"{value:.4g}" for value in values)


def _properties(body: Structure) -> dict[str, Array]:
    """Linear properties of a structure by their names, of loads of size 1."""
    squares, _ = body.eigenmodes(body.factor, 1)
    under_loads = body.factor.solve(body.load_vectors)
    at_loads = np.sum(body.load_vectors * under_loads, axis=0)
    at_probe = (body.probe_rows @ under_loads).ravel()
    return {
        "the first natural frequency in Hz": np.sqrt(np.abs(squares)) / (2.0 * np.pi),
        "the flexibility at the loads in m/N": body.comm.allreduce(at_loads),
        "the displacement of the observed place by 1 N in m": body.comm.allreduce(at_probe),
    }

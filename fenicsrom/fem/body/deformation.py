"""The local deformation of a solid at its quadrature points."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.online.stress.deformation import NOWHERE, Deformation, deformation, extremes
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.scene import Scene


def body_deformation(body: ElasticBody, scene: Scene, u: Array) -> Deformation:
    """The deformation at a displacement u (local,), over all ranks. Collective.

    It is that of the points at which the forms of the body of a scene are integrated.
    """
    position, found = body.quadrature_points(body.quadrature_degree), [NOWHERE]
    number = body.materials.of_points(len(position) // max(1, body.owned_cells().size))
    for weights, gradients in body.tabulate(np.zeros((body.local, 0)), u):
        here, position = np.split(position, [weights.size])
        mine, number = np.split(number, [weights.size])
        law = StressLaw.of(scene).at(mine if scene.materials else None)
        change = gradients[:, 0]
        found.append(deformation(law, here, change, np.zeros_like(change)))
    return extremes(body.comm.allgather(extremes(found)))

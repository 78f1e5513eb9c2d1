"""The local deformation of a solid at its quadrature points."""

from __future__ import annotations

import basix
import numpy as np
import ufl
from dolfinx import fem

from fenicsrom.arrays import Array
from fenicsrom.fem.base.forms import compiled_expression
from fenicsrom.fem.body.elasticity import CHUNK_BYTES, ElasticBody
from fenicsrom.online.stress.deformation import NOWHERE, Deformation, deformation, extremes
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.scene import Scene


class DeformationGauge:
    """Measures the deformation at the points at which the forms of a body are integrated."""

    def __init__(self, body: ElasticBody, scene: Scene):
        """Compile the displacement gradient of a body of a scene. Collective."""
        domain, d = body.mesh.domain, body.dimension
        points, _ = basix.make_quadrature(domain.basix_cell(), body.quadrature_degree)
        self._body, self._u = body, fem.Function(body.space)
        self._gradient = compiled_expression(ufl.grad(self._u), points)
        self._law = StressLaw.of(scene)
        self._material = body.materials.of_points(len(points)) if scene.materials else None
        self._position = body.quadrature_points(body.quadrature_degree)
        self._points = len(points)
        self._chunk = max(1, int(CHUNK_BYTES / (8 * 4 * d * d * self._points)))

    def measure(self, u: Array) -> Deformation:
        """The deformation at a displacement u (local,), over all ranks. Collective."""
        body, d = self._body, self._body.dimension
        body.set_field(self._u, u)
        cells, found = body.owned_cells(), [NOWHERE]
        for first in range(0, cells.size, self._chunk):
            part = cells[first : first + self._chunk]
            points = slice(first * self._points, (first + part.size) * self._points)
            values = np.asarray(self._gradient.eval(body.mesh.domain, part)).reshape(-1, d, d)
            law = self._law.at(None if self._material is None else self._material[points])
            found.append(deformation(law, self._position[points], values, np.zeros_like(values)))
        return extremes(body.comm.allgather(extremes(found)))

"""The cases of the paper: their scenes, the beam and the solid, and the runs of both.

Each run is made once, however many tables and pictures show it.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fenicsrom.assess.studies.compare import Outcome, Workshop, combinations, try_each, try_out
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.beam import beam_structure
from fenicsrom.scene import Scene, read_scene

HERE = Path(__file__).parent
BODIES = ("beam", "solid")
LINEAR = "geometrically_nonlinear=false"
Table = list[list[Any]]


def scene(name: str, *overrides: str) -> Scene:
    """A scene of this folder."""
    return read_scene(HERE / f"{name}.toml", overrides)


@functools.cache
def mesh() -> Any:
    """The one mesh of all scenes."""
    return build_mesh(scene("open").geometry, MPI.COMM_WORLD)


def body(kind: str, of: Scene) -> Any:
    """The beam or the solid of a scene."""
    return beam_structure(of) if kind == "beam" else solid_of(of, mesh())


@functools.cache
def full(kind: str, name: str, *overrides: str) -> Motion:
    """The motion of a full model."""
    of = scene(name, *overrides)
    print(f"full {kind}: {name} {' '.join(overrides)}", flush=True)
    return simulate(full_model(body(kind, of)), of)


@functools.cache
def tried(kind: str, name: str, *overrides: str) -> tuple[Outcome, ...]:
    """The combinations of a scene's [compare] table against the full model."""
    force = ["projection"] if kind == "beam" else ["polynomial"]
    of = scene(name, *overrides, f"compare.elastic_force={force}")
    reference = full(
        kind, name, *(o for o in overrides if not o.startswith(("compare.", "basis.")))
    )
    workshop = Workshop(body(kind, of), of, {})
    attempt = functools.partial(try_out, workshop, of, full=reference, timing=False)
    return tuple(try_each(combinations(of), attempt)[0])


def error(outcome: Outcome) -> str:
    """Give the error of the tip amplitude and (the size); a star marks an unsteady motion."""
    if outcome.motion is None:
        return "stops"
    value = outcome.errors["amplitude_tangential"]
    star = "" if outcome.motion.steady else "*"
    return f"{value:.2g}{star} ({len(outcome.labels)})" if value is not None else "–"


def millimetres(motion: Motion) -> tuple[float, float]:
    """Tip amplitudes across and along the beam, mm; a probe's first axis is x."""
    found = measures.amplitudes(motion)
    return 1e3 * found["tangential"][0], 1e3 * found["normal"]

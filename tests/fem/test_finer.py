"""Elements of one degree more judge the mesh: the same places, and the error of coarse meshes."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from support import STOCKY, beam_scene, make_solid, random_field, touching

pytest.importorskip("dolfinx")

from dolfinx import fem

from fenicsrom import study
from fenicsrom.assess.errors.estimates import distances
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.solid import finer as finer_module
from fenicsrom.fem.solid.finer import FinerSolid, too_large
from fenicsrom.reduction.candidates import finer_model
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import Reduction

SPREAD = touching(at="nodes", normal=[1.0, 0.0], preload=1.0, friction=0.1)
PRESSED = {"group": "load", "direction": [0.0, 1.0], "force": 1.0, "frequency": 1.0}
BODY = {"direction": [0.0, 1.0], "acceleration": 9.81}


@pytest.fixture(scope="module", params=["structured", "simplex"])
def pair(request: pytest.FixtureRequest) -> tuple[Any, FinerSolid]:
    """A stocky beam with a contact at nodes, and the same with elements of degree 3."""
    cells = f"geometry.cells='{request.param}'"
    scene = beam_scene(2, (*STOCKY, cells), contacts=[SPREAD], loads=[PRESSED, BODY])
    solid = make_solid(scene)
    return solid, FinerSolid(scene, solid)


def refined(solid: Any, finer: FinerSolid, values: Any) -> Any:
    """The displacement of a solid as one of the finer elements."""
    found = fem.Function(finer.space)
    found.interpolate(solid.field(values))
    return found.x.array[: finer.local]


def test_finer_elements_hold_the_displacements_and_places_of_the_coarser(pair: Any) -> None:
    solid, finer = pair
    u = random_field(solid, 1e-9)  # the rules agree on linear strains
    v = refined(solid, finer, u)
    f = random_field(solid, 1.0, seed=1)
    assert finer.lifted(f[:, None])[:, 0] @ v == pytest.approx(f @ u, rel=1e-9)
    for rows, more in (
        (solid.contact_rows, finer.contact_rows),
        (solid.probe_rows, finer.probe_rows),
        (solid.load_vectors.T, finer.load_vectors.T),
    ):
        np.testing.assert_allclose(more @ v, rows @ u, rtol=1e-11)
    assert finer.energy(v) == pytest.approx(solid.energy(u), rel=1e-7)
    inertia = v @ finer.mass_times(v[:, None])[:, 0]
    assert inertia == pytest.approx(u @ solid.mass_times(u[:, None])[:, 0], rel=1e-9)


def test_finer_elements_are_softer(pair: Any) -> None:
    solid, finer = pair
    p, more = solid.load_vectors[:, 0], finer.load_vectors[:, 0]
    work = p @ solid.factor.solve(p[:, None])[:, 0]
    assert 1.0 < more @ finer.factor.solve(more[:, None])[:, 0] / work < 1.1


COARSE = tuple(
    """
    geometry.parameters.elements_along=2 geometry.parameters.load_at=0.5 basis.modes=2
    basis.derivatives='all' reference={} output.pictures=false output.paraview=false
""".split()
)


@pytest.mark.slow
def test_two_elements_along_a_beam_are_refused(tmp_path: Any) -> None:
    """Four times as many elements give the true error; the estimate is 1 to 2 times as large."""
    open_beam: dict[str, Any] = {"contacts": None, "probe": {"group": "tip"}}
    found = study.run(beam_scene(2, COARSE, **open_beam), folder=tmp_path)
    assert found.unfinished is not None
    error: Any = found.unfinished[1]
    assert error.kind is ErrorKind.MESH and error.key == "geometry"
    fine = tuple(text.replace("along=2", "along=8") for text in COARSE)
    better = study.run(beam_scene(2, fine, **open_beam))
    true = distances(found.motions["reduced"], better.motions["reduced"]).amplitude
    assert true > 0.3 and true < found.errors["mesh"].amplitude < 2.0 * true
    assert better.unfinished is None and better.errors["mesh"].amplitude < 0.05


def test_body_too_large_for_finer_elements_is_named(
    pair: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    solid, finer = pair
    assert too_large(solid) is None
    monkeypatch.setattr(finer_module, "LARGEST", solid.size)
    assert f"degree {finer.geometry.degree}" in str(too_large(solid))


def test_model_of_finer_elements_has_the_coordinates_of_the_basis() -> None:
    """Its vectors take the same forces, so both models move the probe almost alike."""
    scene = beam_scene(2, (*COARSE, "geometry.parameters.elements_along=8"))
    solid = make_solid(scene)
    found = Reduction(solid, scene, lambda stage: nullcontext())
    model: Any = found.model
    finer, labels, _ = finer_model(solid, FinerSolid(scene, solid), scene.basis, found)
    for name in ("probe", "contact_rows", "mass"):
        ours, theirs = getattr(model, name), getattr(finer, name)
        np.testing.assert_allclose(theirs, ours, atol=0.05 * np.abs(ours).max())
    assert labels == found.basis.labels


def test_model_of_finer_elements_has_the_responses_that_the_coarse_modes_lack() -> None:
    """Two linear elements lock, so their modes leave out more of the load than those of others."""
    locking = ("geometry.degree=1", "geometry.parameters.elements_along=2", "basis.modes=2")
    open_beam: dict[str, Any] = {"contacts": None, "probe": {"group": "tip"}}
    scene = beam_scene(2, (*COARSE, *locking), **open_beam)
    solid = make_solid(scene)
    found = Reduction(solid, scene, lambda stage: nullcontext())
    finer = FinerSolid(scene, solid)
    assert not component_modes(finer, scene.basis).loads.labels
    assert "1L" in found.basis.labels
    assert finer_model(solid, finer, scene.basis, found)[1] == found.basis.labels

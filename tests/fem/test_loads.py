"""Tractions, pressures and accelerations: their resultants, beam theory, and the statics of a
twisted blade."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import STOCKY, beam_scene, make_solid, refusal

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene import Load, Place, parse_scene, read_scene

Array = NDArray[np.float64]

DEMOS = Path(__file__).parents[2] / "demos"
HEIGHT, WIDTH, DENSITY = 0.2, 0.15, 7801.0
TINY = (*STOCKY, "geometry.parameters.elements_along=2")
KINDS = {
    "quadrilaterals": (2, (f"geometry.thickness={WIDTH}",)),
    "triangles": (2, (f"geometry.thickness={WIDTH}", "geometry.cells='simplex'")),
    "hexahedra": (3, (f"geometry.parameters.width={WIDTH}",)),
    "tetrahedra": (3, (f"geometry.parameters.width={WIDTH}", "geometry.cells='simplex'")),
}
EVERYWHERE = {"box": [[-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]]}


@pytest.fixture(scope="module", params=KINDS)
def stocky(request: pytest.FixtureRequest) -> Any:
    """A stocky cantilever, 1 m by `HEIGHT` by `WIDTH`, of each kind of cell."""
    dimension, overrides = KINDS[request.param]
    return make_solid(beam_scene(dimension, (*TINY, *overrides)))


def blade(along: int, across: int, cells: str = "structured", **tables: Any) -> Any:
    """The blade of `blade.geo`, its tip the probe."""
    table = {
        "geometry": {
            "mesh": "blade.geo",
            "dimension": 3,
            "curved": True,
            "cells": cells,
            "parameters": {"elements_along": along, "elements_across": across},
        },
        "material": {"young": 114e9, "poisson": 0.33, "density": 4430.0},
        "supports": [{"group": "root"}],
        "probe": {"group": "tip"},
    } | tables
    return make_solid(parse_scene(table, "blade", Path.cwd()))


@pytest.fixture(scope="module")
def curved() -> Any:
    return blade(6, 4)


def box(d: int) -> Place:
    low, high = EVERYWHERE["box"]
    return Place(box=(tuple(low[:d]), tuple(high[:d])))


def acting(solid: Any, **given: Any) -> tuple[Array, Array]:
    """Resultant (d,) of a load of size 1, clamped nodes included, and its moments (d, d): sum of
    f_i x_j."""
    d = solid.dimension
    place = given.pop("place", Place())
    vector = solid.load_vector(Load.of(**vars(place), **given), "loads[0]").reshape(-1, d)
    x = solid.space.tabulate_dof_coordinates()[: vector.shape[0], :d]
    return vector.sum(axis=0), vector.T @ x


def slanted(d: int) -> Array:
    direction = np.array([0.3, -0.5, 0.8][:d])
    return direction / np.linalg.norm(direction)


# ------------------------------------------------------------------ resultants


@pytest.mark.slow
@pytest.mark.parametrize("group", ["tip", "load", "root"])
def test_resultant_of_traction_is_traction_times_area(stocky: Any, group: str) -> None:
    d = stocky.dimension
    total, moments = acting(
        stocky, traction=1.0, direction=tuple(slanted(d)), place=Place(group=group)
    )
    np.testing.assert_allclose(total, HEIGHT * WIDTH * slanted(d), rtol=1e-12)
    where = {"tip": 1.0, "load": 0.5, "root": 0.0}[group]
    np.testing.assert_allclose(
        moments[:, 0], where * total, rtol=0, atol=1e-12 * np.abs(total).max()
    )


def test_resultant_of_acceleration_is_acceleration_times_mass(stocky: Any) -> None:
    d = stocky.dimension
    total, moments = acting(stocky, acceleration=1.0, direction=tuple(slanted(d)))
    np.testing.assert_allclose(total, DENSITY * HEIGHT * WIDTH * slanted(d), rtol=1e-12)
    np.testing.assert_allclose(moments[:, 0], 0.5 * total, rtol=1e-12)


def test_resultant_of_pressure_is_against_the_normal(stocky: Any) -> None:
    d = stocky.dimension
    total, _ = acting(stocky, pressure=1.0, place=Place(group="tip"))
    np.testing.assert_allclose(total, -HEIGHT * WIDTH * np.eye(d)[0], rtol=0, atol=1e-15)
    # all around it the resultant and the couples vanish, and -sum f_i x_i is the volume in each
    # direction
    total, moments = acting(stocky, pressure=1.0, place=box(d))
    volume = HEIGHT * WIDTH
    np.testing.assert_allclose(total, 0.0, atol=1e-13 * volume)
    np.testing.assert_allclose(moments, -volume * np.eye(d), rtol=0, atol=1e-12 * volume)


def test_resultants_on_curved_blade_match_its_surface_and_mass(curved: Any) -> None:
    """The closed surface of the blade gives the volume from which its mass follows."""
    total, moments = acting(curved, pressure=1.0, place=box(3))
    mass = acting(curved, acceleration=1.0, direction=(0.0, 1.0, 0.0))[0][1]
    area = acting(curved, traction=1.0, direction=(1.0, 0.0, 0.0), place=box(3))[0][0]
    assert 0.2 < area < 0.3
    np.testing.assert_allclose(total, 0.0, atol=1e-14 * area)
    np.testing.assert_allclose(
        moments, -mass / 4430.0 * np.eye(3), rtol=0, atol=1e-12 * mass / 4430.0
    )
    pressed = acting(curved, pressure=1.0, place=Place(group="pressure"))[0]
    # the hollow side faces -z at the root and, turned by 50 degrees, +y at the tip: pressed, the
    # blade goes to +z and -y
    assert pressed[2] > 0.05 and pressed[1] < -0.02


def test_base_excitation_load_is_mass_times_translation(stocky: Any) -> None:
    """At nodes without a clamped neighbour the load is M times the translation."""
    d = stocky.dimension
    ones = np.tile(np.eye(d)[1], stocky.local // d)
    load = stocky.load_vector(Load.of(acceleration=1.0, direction=tuple(np.eye(d)[1])), "loads[0]")
    x = np.repeat(stocky.space.tabulate_dof_coordinates()[: stocky.local // d, 0], d)
    far = x > 0.5 + 1e-9  # in the second of the two elements
    np.testing.assert_allclose(
        load[far], stocky.mass_times(ones[:, None])[far, 0], rtol=0, atol=1e-12 * np.abs(load).max()
    )


# ------------------------------------------------------------------ deflections


def beam(dimension: int, *loads: Any, **given: Any) -> Any:
    overrides = given.pop("overrides", ())
    tables = {"contacts": None, "probe": {"group": "tip"}, "geometrically_nonlinear": False} | given
    return make_solid(beam_scene(dimension, overrides, loads=list(loads), **tables))


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "tolerance"), [(2, 1e-3), (3, 2e-3)])
def test_tip_under_uniform_load_matches_timoshenko(dimension: int, tolerance: float) -> None:
    """w = q L^4 / (8 EI) + q L^2 / (2 kappa GA), for a traction on the top, a pressure on the
    underside, and the weight.

    Reference: tip under traction, pressure or acceleration | Timoshenko beam | closed form |
    agrees | 0.1 % (2D); 0.2 % (3D)
    """
    length, side = 2.54, 0.0254
    up = [0.0, 1.0, 0.0][:dimension]

    def face(y: float) -> dict[str, Any]:
        return {"plane": {"point": [0.0, y, 0.0][:dimension], "normal": up}}

    q = 30.0  # N/m
    area, inertia = side**2, side**4 / 12
    exact = q * length**4 / (8 * 207e9 * inertia) + q * length**2 / (
        2 * 5 / 6 * 207e9 / 2.56 * area
    )
    found = [
        tip_of(beam(dimension, load, overrides=("geometry.parameters.elements_along=80",)))[1]
        for load in (
            {**face(0.5 * side), "direction": up, "traction": q / side},
            {**face(-0.5 * side), "pressure": q / side},
            {"direction": up, "acceleration": q / (DENSITY * area)},
        )
    ]
    assert found[0] == pytest.approx(exact, rel=tolerance)
    np.testing.assert_allclose(found, found[0], rtol=1e-4)


def tip_of(solid: Any) -> Array:
    return np.asarray(solid.probe_rows @ solid.equilibrium)


@pytest.mark.slow
def test_tip_of_pressed_blade_converges_with_the_mesh() -> None:
    """Nonlinear statics, 60 kPa on the concave side: the tip moves by 97.8 mm, 14 % of the span."""

    def tip(along: int, across: int, *overrides: str) -> Array:
        size = (
            f"geometry.parameters.elements_along={along}",
            f"geometry.parameters.elements_across={across}",
        )
        return tip_of(make_solid(read_scene(DEMOS / "blade_pressed.toml", (*size, *overrides))))

    tips = [tip(6, 4), tip(12, 8), tip(24, 16)]
    far = float(np.linalg.norm(tips[-1]))
    assert far == pytest.approx(0.0978, rel=1e-3)
    first, second = (float(np.linalg.norm(a - b)) / far for a, b in itertools.pairwise(tips))
    assert second < 0.2 * first and second < 1e-3
    # tetrahedra come to the same, more slowly
    coarse, fine = (
        np.linalg.norm(tip(*size, "geometry.cells='simplex'") - tips[-1])
        for size in ((12, 8), (24, 16))
    )
    assert fine < 0.2 * coarse and fine < 8e-3 * far
    linear = tip(12, 8, "geometrically_nonlinear=false")
    assert np.linalg.norm(linear - tips[1]) > 0.02 * far


# ------------------------------------------------------------------ what is refused


def test_pressure_on_facets_inside_the_body_is_refused() -> None:
    with refusal(ErrorKind.PLACE, "loads[0].pressure"):
        beam(2, {"group": "load", "pressure": 5.0})


def test_load_of_the_beam_that_is_no_point_force_is_refused() -> None:
    from fenicsrom.reduction.beam import beam_structure

    section = {"length": 2.54, "height": 0.0254, "width": 0.0254, "load_at": 0.7}
    scene = beam_scene(
        2,
        loads=[{"group": "tip", "pressure": 1.0, "frequency": 3.0}],
        reference={"beam": True, "beam_section": section},
    )
    with refusal(ErrorKind.CONFLICT, "reference.beam", names="pressure"):
        beam_structure(scene)


# ------------------------------------------------------------------ runs


STATIC = """
[geometry]
mesh = "beam2d.geo"
dimension = 2
thickness = 0.0254
[material]
young = 207e9
poisson = 0.28
density = 7801.0
[[supports]]
group = "root"
[[loads]]
direction = [0.0, -1.0]
acceleration = 9.81
[probe]
group = "tip"
"""


def test_static_scene_ends_with_its_equilibrium(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from fenicsrom.cli import main

    scene = tmp_path / "weight.toml"
    scene.write_text(STATIC)
    quiet = ["--set", "output.pictures=false"]
    assert main(["run", str(scene), "--output", str(tmp_path / "out"), *quiet]) == 0
    found = json.loads((tmp_path / "out" / "summary.json").read_text())
    x, y = found["equilibrium"]["displacement_m"]
    load, inertia = DENSITY * 0.0254**2 * 9.81, 0.0254**4 / 12
    assert y == pytest.approx(-load * 2.54**4 / (8 * 207e9 * inertia), rel=5e-3) and -2e-3 < x < 0.0
    capsys.readouterr()
    assert found["response"] == {} and found["frequencies_Hz"] == []
    assert (tmp_path / "out" / "equilibrium.vtu").exists()
    # its modes can be asked for all the same, about the equilibrium
    command = ["modes", str(scene), "--output", str(tmp_path / "modes")]
    assert main([*command, *quiet]) == 0
    assert "1V 3.2" in " ".join(capsys.readouterr().out.split())
    assert main(["compare", str(scene), "--output", str(tmp_path / "compare")]) == 2
    assert "loads: all are static" in capsys.readouterr().err


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A beam whose base moves by a table: the folder of its run, and its study."""
    from mpi4py import MPI

    from fenicsrom import study

    folder = tmp_path_factory.mktemp("struck")
    (folder / "base.csv").write_text("t,f\n0,0\n0.02,1\n0.03,-0.5\n0.06,0\n")
    text = STATIC.replace("acceleration = 9.81", 'acceleration = 50.0\ntable = "base.csv"')
    scene = folder / "s.toml"
    quick = (
        "[basis]\nmodes = 2\n[time]\nduration = 0.2\nstep = 1e-3\n"
        "[output]\npictures = false\nparaview = false\n"
    )
    scene.write_text(text + quick)
    found = study.run(read_scene(scene), MPI.COMM_WORLD, folder=folder / "out")
    return folder, found


@pytest.mark.slow
def test_stored_model_keeps_the_table_of_its_load(struck: tuple[Path, Any]) -> None:
    from fenicsrom.online.store.archive import load_model

    folder, found = struck
    stored = load_model(folder / "out" / "reduced_model.npz")
    assert stored.scene.loads[0].history.rows == (
        (0.0, 0.0),
        (0.02, 1.0),
        (0.03, -0.5),
        (0.06, 0.0),
    )
    again = stored.with_overrides(()).simulate()
    np.testing.assert_allclose(
        again.displacement, found.motions["reduced"].displacement, rtol=0, atol=1e-12
    )
    # another table, and twice the size, of a motion so small that it is linear
    (folder / "other.csv").write_text("0,0\n0.02,1e-4\n0.03,-0.5e-4\n0.06,0\n")
    small = stored.with_overrides([f'loads.0.table="{folder / "other.csv"}"']).simulate()
    twice = stored.with_overrides(
        [f'loads.0.table="{folder / "other.csv"}"', "loads.0.acceleration=100"]
    ).simulate()
    np.testing.assert_allclose(
        twice.displacement,
        2 * small.displacement,
        rtol=0,
        atol=1e-6 * np.abs(twice.displacement).max(),
    )
    for override in (
        "loads.0.direction=[1.0, 0.0]",
        "loads.0={direction=[0.0, -1.0], acceleration=1.0}",
    ):
        with pytest.raises(SceneError) as refusal:
            stored.with_overrides([override])
        assert refusal.value.kind is ErrorKind.MISMATCH


@pytest.mark.slow
def test_reduced_model_under_base_excitation_matches_full_model(struck: tuple[Path, Any]) -> None:
    """Base excitation by a table: in both models the adaptive steps end at the corners of the
    table."""
    from dataclasses import replace

    from fenicsrom.fem.full.full import full_model
    from fenicsrom.online.run.simulate import simulate

    _, found = struck
    scene = replace(found.scene, time=found.scene.time.changed(tolerance=1e-5))
    reduced, full = simulate(found.model, scene), simulate(full_model(found.solid), scene)
    for motion in (reduced, full):
        assert all(np.min(np.abs(motion.time - time)) < 1e-12 for time in (0.02, 0.03, 0.06))
    y = np.interp(full.time, reduced.time, reduced.displacement[:, 0, 1])
    assert np.abs(y - full.displacement[:, 0, 1]).max() < 1e-2 * np.abs(y).max()

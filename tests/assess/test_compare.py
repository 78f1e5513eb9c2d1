"""Error against run time: agreement, indicator, cache, and bases against the full model."""

import csv
import shutil
from dataclasses import replace
from types import SimpleNamespace

import motions
import numpy as np
import pytest
from support import STOCKY, beam_scene, heard, make_solid

from fenicsrom.assess.errors import agreement
from fenicsrom.assess.errors import comparisons as residual
from fenicsrom.assess.full import full_motions as full_cache
from fenicsrom.assess.studies import compare
from fenicsrom.assess.studies.compare import Combination
from fenicsrom.errors import SceneError
from fenicsrom.notes import NoteKind
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store import store as result_cache


def motion(
    across=1.0, along=0.1, phase=0.0, force=10.0, friction_dissipation=2.0, switch=0.5, steps=200
):
    """Two periods of a point that moves by sines; the contact opens at a fraction of each
    period."""
    parts = np.arange(2 * steps + 1) / steps
    x = np.zeros((parts.size, 1, 2))
    x[:, 0, 0] = along * np.cos(4 * np.pi * parts)
    x[:, 0, 1] = across * np.sin(2 * np.pi * parts + phase)
    forces = np.zeros_like(x)
    forces[:, 0, 0] = force * np.sin(2 * np.pi * parts) ** 2
    state = np.where(parts[:, None] % 1.0 < switch, 0, -1).astype(np.int8)
    return motions.motion(motions.PERIOD * parts, x, forces, state, friction_dissipation * parts)


def test_errors_of_known_motions_match_hand_calculation():
    reference = motion()
    assert all(
        error == pytest.approx(0.0, abs=1e-9)
        for error in agreement.motion_errors(reference, reference).values()
    )
    found = agreement.motion_errors(
        motion(across=1.02, along=0.07, force=11.0, friction_dissipation=1.5, switch=0.75),
        reference,
    )
    assert found["amplitude_tangential"] == pytest.approx(2.0)
    assert found["amplitude_normal"] == pytest.approx(30.0)
    assert found["peak_normal_force"] == pytest.approx(10.0)
    assert found["friction_dissipation_per_period"] == pytest.approx(25.0)
    assert found["state"] == pytest.approx(25.0, abs=0.6)
    assert agreement.wrong_state(reference, motion(switch=0.75)) == pytest.approx(
        25.0, abs=0.6
    )  # either way
    whole = np.sqrt((0.02**2 + 0.03**2) / (1.0 + 0.1**2))
    assert found["history"] == pytest.approx(100 * whole, rel=1e-3)


def test_phase_shift_is_an_error_of_the_history_only():
    found = agreement.motion_errors(motion(along=0.0, phase=0.01, steps=170), motion(along=0.0))
    assert found["amplitude_tangential"] < 0.01
    assert found["history"] == pytest.approx(100 * 2 * np.sin(0.005), rel=1e-2)
    assert found["amplitude_normal"] is None  # the reference does not move that way


def test_break_even_is_the_least_whole_number_of_runs():
    assert agreement.break_even(offline=10.0, online=1.0, full=3.0) == 5
    assert agreement.break_even(offline=10.1, online=1.0, full=3.0) == 6
    assert agreement.break_even(offline=0.5, online=1.0, full=3.0) == 1
    assert agreement.break_even(offline=0.5, online=3.0, full=3.0) is None


def test_pareto_front_of_five_points_has_three():
    costs, errors = [1.0, 2.0, 2.0, 3.0, 4.0], [5.0, 3.0, 2.0, 2.5, 1.0]
    assert agreement.pareto_front(costs, errors) == [0, 2, 4]


def test_rank_correlation_shares_ranks_of_ties():
    assert agreement.rank_correlation([1, 2, 3, 4], [10, 20, 30, 4000]) == pytest.approx(1.0)
    assert agreement.rank_correlation([1, 2, 3, 4], [4, 3, 2, 1]) == pytest.approx(-1.0)
    assert agreement.rank_correlation([1, 2, 2, 4], [1, 3, 2, 4]) == pytest.approx(0.9486833)
    assert agreement.rank_correlation([1, 1, 1], [1, 2, 3]) is None


# ------------------------------------------------------------------ combinations


def test_combinations_are_the_product_of_the_lists():
    scene = beam_scene(
        overrides=("compare.modes=[1,2]", 'compare.elastic_force=["polynomial","projection"]')
    )
    found = compare.combinations(scene)
    assert len(found) == len(set(found)) == 2 * 5 * 2 * 2
    linear = compare.combinations(
        beam_scene(overrides=("geometrically_nonlinear=false", "compare.modes=[1,2]"))
    )
    assert {c.derivatives for c in linear} == {"none"} and len(linear) == 4


def test_combination_sets_basis_and_scheme_of_the_scene():
    scene = beam_scene(overrides=('time.scheme="generalised-alpha"', "time.spectral_radius=0.5"))
    wanted = Combination("craig-bampton", 2, ("1V1V",), "projection", "discrete-gradient")
    found = compare.with_combination(scene, wanted)
    assert (found.basis.method, found.basis.modes, found.basis.derivatives) == (
        "craig-bampton",
        2,
        ("1V1V",),
    )
    assert (found.time.scheme, found.time.spectral_radius) == ("discrete-gradient", None)
    with pytest.raises(SceneError, match="3V3V"):
        compare.with_combination(
            scene, Combination("rubin", 2, ("3V3V",), "polynomial", "discrete-gradient")
        )


def test_meshes_and_steps_are_further_choices():
    scene = beam_scene(
        overrides=(
            *STOCKY,
            "compare.modes=[1]",
            'compare.methods=["rubin"]',
            'compare.derivatives=["none"]',
            'compare.meshes=["geometry.degree=1", "geometry.parameters.elements_along=2"]',
            "compare.steps=[50, 100]",
        )
    )
    found = [compare.with_combination(scene, c) for c in compare.combinations(scene)]
    own = scene.geometry.parameters
    meshes = [(2, own), (1, own), (2, {**own, "elements_along": 2})]
    assert [
        (of.geometry.degree, of.geometry.parameters, of.time.steps_per_period) for of in found
    ] == [(*mesh, steps) for mesh in meshes for steps in (50, 100)]


@pytest.mark.slow
def test_coarse_mesh_and_long_steps_are_compared_with_the_full_model_of_the_scene(tmp_path):
    """The first frequency of a cell of degree 1 is far too high; the load is below resonance."""
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    from fenicsrom.post.studies.compare_report import report

    scene = beam_scene(
        overrides=(
            *STOCKY,
            "compare.modes=[2]",
            'compare.methods=["rubin"]',
            'compare.derivatives=["none"]',
            'compare.meshes=["geometry.degree=1"]',
            "compare.steps=[50, 10]",
            "time.steps_per_period=50",
            "loads.0.frequency=50.0",
            "material.mass_damping=500.0",
        ),
        geometrically_nonlinear=False,
        contacts=None,
        probe={"group": "tip"},
    )
    found = compare.compare(scene, MPI.COMM_SELF)
    own, longer, linear, both = (o.errors["amplitude_tangential"] for o in found.outcomes)
    assert own < 0.5 * longer < 0.1 * min(linear, both)
    report(found).write(tmp_path)
    with (tmp_path / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["mesh"], row["steps_per_period"]) for row in rows] == [
        (mesh, steps) for mesh in ("", "geometry.degree=1") for steps in ("50", "10")
    ]


def test_motion_that_does_not_repeat_leaves_a_doubt():
    scene = beam_scene()
    moved = SimpleNamespace(period=1.0, steady=False)
    outcome = compare.Outcome(compare.combinations(scene)[0], motion=moved)
    (note,) = compare.outcome_notes(scene, [outcome])
    assert note.kind is NoteKind.UNSETTLED and outcome.combination.name in str(note)
    unjudged = replace(scene, time=scene.time.changed(steady_tolerance=0.0))
    assert not compare.outcome_notes(unjudged, [outcome])


# ------------------------------------------------------------------ the indicator

QUICK = (
    *STOCKY,
    "time.steps_per_period=40",
    "time.periods=2",
    "time.steady_tolerance=0.0",
    "loads.0.force=1e5",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme", ["discrete-gradient", "average-acceleration", "generalised-alpha"]
)
@pytest.mark.parametrize("kind", ["solid", "beam"])
def test_identity_basis_has_no_residual(scheme, kind):
    pytest.importorskip("dolfinx")
    from fenicsrom.fem.full.full import full_model
    from fenicsrom.reduction.beam import beam_structure

    section = {"length": 1.0, "height": 0.2, "width": 0.0254, "elements": 4, "load_at": 0.5}
    scene = beam_scene(
        overrides=(
            *QUICK,
            f'time.scheme="{scheme}"',
            "loads.0.frequency=30.0",
            "contacts.0.preload=1e-3",
        ),
        reference={"beam": True, "beam_section": section},
    )
    body = make_solid(scene) if kind == "solid" else beam_structure(scene)
    found = simulate(full_model(body), scene, keep_coordinates=True)
    assert {-1, 0} <= set(
        found.state.ravel().tolist()
    )  # the contact takes part, and is lost and found within steps
    indicator, plain = residual.indicators(body, np.eye(body.local), found, scene)
    assert indicator < 1e-8 and plain < 1e-6
    # and it is no zero that anything would give: a hundredth less motion leaves a residual
    less = replace(found, coordinates=0.99 * found.coordinates, velocity=0.99 * found.velocity)
    assert residual.indicators(body, np.eye(body.local), less, scene)[0] > 1e-3


def test_indicator_of_body_at_rest_is_root_mean_square_of_sine():
    """The residual is the harmonic load of 2 N; the static load is balanced and does not count."""
    pytest.importorskip("dolfinx")
    from fenicsrom.fem.full.full import full_model

    load = {"group": "load", "at": "centre", "direction": [0.0, 1.0]}
    scene = beam_scene(
        overrides=QUICK[:-1],
        loads=[load | {"force": 2.0, "frequency": 30.0}, load | {"force": 4.0}],
        contacts=None,
        probe={"group": "tip"},
    )
    body = make_solid(scene)
    found = simulate(full_model(body), scene, keep_coordinates=True)
    rest = np.zeros_like(found.coordinates)
    still = replace(found, coordinates=rest, velocity=rest, acceleration=rest)
    for value in residual.indicators(body, np.eye(body.local), still, scene):
        assert value == pytest.approx(np.sqrt(0.5), rel=0.05)


@pytest.mark.slow
def test_run_started_from_a_motion_continues_it():
    pytest.importorskip("dolfinx")
    from fenicsrom.fem.full.full import full_model
    from fenicsrom.reduction.beam import beam_structure

    section = {"length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 10, "load_at": 0.7}
    few = ("time.steps_per_period=100", "time.periods=2", "time.steady_tolerance=0.0")
    scene = beam_scene(
        overrides=(*few, "contacts.0.preload=100.0"),
        reference={"beam": True, "beam_section": section},
    )
    model = full_model(beam_structure(scene))
    first = simulate(model, scene, keep_coordinates=True)
    second = simulate(model, scene, start=first)
    longer = simulate(model, replace(scene, time=scene.time.changed(periods=4)))
    assert (
        np.unique(longer.state).size > 1 and abs(first.force[-1, 0, 1]) > 1.0
    )  # the spring of the slider is drawn
    end = longer.displacement[-second.time.size :]
    assert np.abs(second.displacement - end).max() < 1e-9 * np.abs(end).max()
    assert np.array_equal(second.state, longer.state[-second.time.size :])


# ------------------------------------------------------------------ the cache


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("FENICSROM_CACHE")
    return tmp_path / "cache" / "fenicsrom"


@pytest.mark.slow
def test_full_model_runs_once_and_damaged_cache_is_ignored(cache, monkeypatch):
    pytest.importorskip("dolfinx")
    scene = beam_scene(overrides=QUICK)
    solid = make_solid(scene)
    runs = []

    def counted(*args, **kwargs):
        runs.append(1)
        return simulate(*args, **kwargs)

    monkeypatch.setattr(full_cache, "simulate", counted)
    first, note = full_cache.full_motion(solid, scene)
    second, again = full_cache.full_motion(solid, scene)
    assert len(runs) == 1 and not note["cached"] and again["cached"]
    assert again["machine"] == full_cache.machine()
    assert np.array_equal(first.displacement, second.displacement) and second.state.dtype == np.int8
    assert (first.seconds, first.steps, first.period) == (
        second.seconds,
        second.steps,
        second.period,
    )
    (entry,) = (cache / "results").iterdir()
    monkeypatch.setenv("FENICSROM_CACHE", "off")
    assert not full_cache.full_motion(solid, scene)[1]["cached"]
    monkeypatch.delenv("FENICSROM_CACHE")
    # a damaged file is no file
    content = bytearray(entry.read_bytes())
    for damage in (content[: len(content) // 2], b"", b"PK\3\4 no archive"):
        entry.write_bytes(damage)
        assert not full_cache.full_motion(solid, scene)[1]["cached"]
        assert full_cache.full_motion(solid, scene)[1]["cached"]
    middle = len(content) // 2
    content[middle : middle + 64] = bytes(64)
    entry.write_bytes(content)
    assert not full_cache.full_motion(solid, scene)[1]["cached"]


def test_key_changes_with_scene_and_mesh_only_where_they_matter(tmp_path):
    scene = beam_scene()
    key = full_cache.cache_key(scene)
    same = replace(scene, title="another", source="elsewhere", basis=replace(scene.basis, modes=7))
    assert full_cache.cache_key(same) == key
    copy = tmp_path / "copy.geo"
    copy.write_bytes(scene.geometry.mesh.read_bytes())
    moved = replace(scene, geometry=replace(scene.geometry, mesh=copy))
    assert full_cache.cache_key(moved) == key
    copy.write_text(copy.read_text() + "\n// changed")
    assert full_cache.cache_key(moved) != key
    for override in (
        "loads.0.force=1.0",
        "time.steps_per_period=201",
        "contacts.0.friction=0.4",
        "geometry.degree=1",
    ):
        assert full_cache.cache_key(beam_scene(overrides=(override,))) != key


@pytest.mark.slow
def test_key_changes_with_a_module_of_each_package(tmp_path):
    copy = tmp_path / "package"
    shutil.copytree(result_cache.PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    digest = result_cache.package_digest(copy)
    assert digest == result_cache.package_digest(result_cache.PACKAGE)
    modules = list({path.parent: path for path in copy.rglob("*.py")}.values())
    assert {"solid", "step", "reduction", "scene"} <= {path.parent.name for path in modules}
    for module in modules:
        content = module.read_bytes()
        module.write_bytes(content + b"\n# edited\n")
        assert result_cache.package_digest(copy) != digest, module
        module.write_bytes(content)
    modules[-1].rename(modules[-1].with_name("renamed.py"))
    assert result_cache.package_digest(copy) != digest


# ------------------------------------------------------------------ files


@pytest.mark.slow
def test_tiny_comparison_ranks_the_richer_basis_first(cache):
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    scene = beam_scene(
        overrides=(
            *QUICK,
            "compare.modes=[1]",
            'compare.derivatives=["none","all"]',
            'compare.methods=["rubin"]',
            'compare.elastic_force=["polynomial","projection"]',
            'time.steady="march"',
        )
    )
    said = []
    with heard(said.append):
        found = compare.compare(scene, MPI.COMM_SELF)
    plain, plain_projected, rich, rich_projected = found.outcomes
    assert all(len(outcome.online) == 5 for outcome in found.outcomes)
    names = """
        mesh solid modes selection derivatives basis reduction
    """.split()
    assert set(rich.offline) == set(names)
    for one, other in ((plain, plain_projected), (rich, rich_projected)):
        assert (
            np.abs(one.motion.displacement - other.motion.displacement).max()
            < 1e-9 * np.abs(one.motion.displacement).max()
        )
    assert rich.indicator < plain.indicator
    assert rich.errors["history"] < plain.errors["history"]
    assert sum("left" in line for line in said) == 4


# ------------------------------------------------------------------ the paper's cases


def test_comparison_without_acting_load_has_no_indicator():
    """The indicator is relative to the loads; nothing moves without them."""
    from mpi4py import MPI

    scene = beam_scene(
        overrides=(
            *STOCKY,
            "loads.0.force=0",
            "compare={full=false, methods=['rubin'], modes=[1], derivatives=['none']}",
        ),
        contacts=None,
        probe={"group": "tip"},
        time={"periods": 2},
    )
    (outcome,) = compare.compare(scene, MPI.COMM_WORLD).outcomes
    assert not outcome.failure and outcome.motion is not None
    assert outcome.indicator is None and outcome.residual is None


@pytest.mark.slow
def test_sizes_of_the_new_selection_are_an_axis_of_the_comparison(cache):
    pytest.importorskip("dolfinx")
    from mpi4py import MPI

    scene = beam_scene(
        overrides=(
            *QUICK,
            "compare.modes=[2]",
            'compare.derivatives=["principal","mmi-nls"]',
            'compare.methods=["rubin"]',
            "compare.sizes=[7, 9]",
            "compare.full=false",
            "basis.accuracy=1e-4",
        )
    )
    found = compare.compare(scene, MPI.COMM_SELF)
    free, seven, nine, paired = found.outcomes
    assert [len(seven.labels), len(nine.labels)] == [7, 9] and not free.failure
    assert [o.combination.size for o in found.outcomes] == [None, 7, 9, None]
    assert "size" in seven.offline and "size" not in paired.offline
    assert nine.motion is not None and seven.motion is not None and nine.indicator is not None
    assert nine.indicator < 1.5 * seven.indicator

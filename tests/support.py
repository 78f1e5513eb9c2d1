"""Helpers of several test files: differences, slopes, small scenes and models, runs on several
ranks."""

from __future__ import annotations

import atexit
import logging
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from ranks import Ranks

import fenicsrom
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.surfaces import Contacts, frame, planes
from fenicsrom.online.model.loads import LoadHistories, _joined, _sine
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_polynomial, pairs
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.progress import log
from fenicsrom.reduction.basis import strain_products
from fenicsrom.scene import Basis, Material, Scene, Time, override_table, parse_scene

Array = NDArray[np.float64]


def group_names(mesh: Any) -> set[str]:
    """The names of the cell and facet groups of a mesh."""
    return set(mesh.cell_groups) | set(mesh.facet_groups)


def assert_tangent(
    f: Callable[[Array], Any],
    df: Callable[[Array], Any],
    x: Array,
    *,
    step: float = 1e-3,
    tolerance: float = 1e-8,
) -> None:
    """Compare a derivative with differences of fourth order, exact for polynomials of degree 4 at
    any step.

    Args:
        f: the function of x (n,), a number or (m,).
        df: its derivative at x: (n,) or (m, n).
        x: where, (n,).
        step: of the differences, in every component of x.
        tolerance: relative to the largest entry of the derivative.
    """
    given = np.atleast_2d(df(x))
    columns = []
    for k in range(x.size):
        e = np.zeros(x.size)
        e[k] = step
        near = np.array(f(x + e)) - np.array(f(x - e))
        far = np.array(f(x + 2 * e)) - np.array(f(x - 2 * e))
        columns.append(np.atleast_1d((8 * near - far) / (12 * step)))
    differences = np.array(columns).T
    assert given.shape == differences.shape
    size = np.abs(given).max()
    assert np.abs(differences).max() > 0
    error = np.abs(given - differences).max()
    assert error <= tolerance * size, (
        f"derivative off by {error / size:.1e} of its largest entry {size:.3g}"
    )


def random_directions(solid: Any) -> tuple[Array, Array]:
    """A random displacement (n,) of a solid and three directions (3, n)."""
    directions = [random_field(solid, 0.02, seed) for seed in (1, 2, 3)]
    return random_field(solid, 0.02), np.array(directions)


def assert_force_of_energy(solid: Any) -> None:
    """The internal force of a solid is the derivative of its energy."""
    u, directions = random_directions(solid)
    assert_tangent(
        lambda s: solid.energy(u + s @ directions),
        lambda s: directions @ solid.internal_force(u + s @ directions),
        np.zeros(3),
        step=0.5,
        tolerance=1e-9,
    )


def assert_tangent_of_force(solid: Any) -> None:
    """The tangent of a solid is the derivative of its internal force."""
    u, directions = random_directions(solid)
    assert_tangent(
        lambda s: solid.internal_force(u + s @ directions),
        lambda s: solid.tangent_times(u + s @ directions, directions.T),
        np.zeros(3),
        step=0.5,
        tolerance=1e-9,
    )


def assert_polynomial_is_exact(solid: Any) -> None:
    """The elastic polynomial of a solid equals its projected internal force, to rounding."""
    n = 3
    vectors = np.array([random_field(solid, 0.05, seed) for seed in range(n)]).T
    found = solid.elastic_polynomial(vectors)
    i, j = pairs(n)
    for seed in range(3):
        q = np.random.default_rng(seed).standard_normal(n)
        a, b = np.zeros((2, n, n))
        a[i, j] = a[j, i] = found.quadratic @ q
        b[i, j] = b[j, i] = found.cubic @ (q[i] * q[j])
        force = found.force + (found.stiffness + a / 2.0 + b / 3.0) @ q
        expected = vectors.T @ solid.internal_force(solid.equilibrium + vectors @ q)
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def slope(steps: Any, errors: Any) -> float:
    """Observed order: the slope of log(errors) against log(steps), by least squares."""
    return float(
        np.polyfit(np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float)), 1)[0]
    )


# ------------------------------------------------------------------ scenes

KINDS_OF_CELLS: dict[str, tuple[int, tuple[str, ...]]] = {
    "plane stress": (2, ()),
    "plane strain": (2, ("geometry.plane='strain'",)),
    "triangles": (2, ("geometry.cells='simplex'",)),
    "hexahedra": (3, ("geometry.parameters.width=0.15",)),
    "tetrahedra": (3, ("geometry.parameters.width=0.15", "geometry.cells='simplex'")),
}

STEEL = {"young": 207e9, "poisson": 0.28, "density": 7801.0, "mass_damping": 5.0}


def contact_points(*normals: Sequence[float]) -> ContactPoints:
    """Points of one contact, all at the origin, with these normals; at least one."""
    frames = np.array([frame(np.array(normal)) for normal in normals])
    count, d = len(normals), len(normals[0])
    area, place = np.full(count, 1.0 / count), np.zeros((count, d))
    return ContactPoints(np.zeros(count, np.int64), area, place, frames)


def touching(**keys: Any) -> dict[str, Any]:
    """The table of a contact at the tip, with two springs of 1e4 and a friction of 0.5, and these
    keys."""
    springs = {"normal_stiffness": 1e4, "tangential_stiffness": 1e4, "friction": 0.5}
    return {"group": "tip", **springs, **keys}


def beam_scene(dimension: int = 2, overrides: tuple[str, ...] = (), **tables: Any) -> Scene:
    """The paper's case: a cantilever whose tip rubs against a wall, loaded at 0.7 of its length, at
    the centre nodes.

    Args:
        dimension: 2 or 3.
        overrides: as on the command line, such as "geometry.degree=1".
        tables: whole tables of the scene in place of those below; None leaves one out.
    """
    up, along = [[0.0, 1.0, 0.0][:dimension], [1.0, 0.0, 0.0][:dimension]]
    geometry: dict[str, Any] = {
        "mesh": f"beam{dimension}d.geo",
        "dimension": dimension,
        "parameters": {},
    }
    if dimension == 2:
        geometry["thickness"] = 0.0254
    table = {
        "geometry": geometry,
        "material": STEEL,
        "supports": [{"group": "root"}],
        "loads": [
            {"group": "load", "at": "centre", "direction": up, "force": 111.29, "frequency": 3.2}
        ],
        "contacts": [touching(at="centre", normal=along, preload=40.0)],
    } | tables
    table = {name: value for name, value in table.items() if value is not None}
    return parse_scene(override_table(table, overrides, "test"), "test", Path.cwd())


STOCKY = tuple(
    f"geometry.parameters.{size}"
    for size in ("length=1", "height=0.2", "elements_along=4", "load_at=0.5")
)
"""Overrides that make the beam short and its mesh tiny."""


_SCENES: WeakKeyDictionary[Any, Scene] = WeakKeyDictionary()


def make_solid(scene: Scene) -> Any:
    """Mesh and solid of a scene; `scene_of` gives the scene back."""
    from mpi4py import MPI

    from fenicsrom.fem.solid.solid import build_solid

    solid = build_solid(scene, MPI.COMM_WORLD)
    _SCENES[solid] = scene
    return solid


def scene_of(solid: Any) -> Scene:
    """The scene that a solid was made from by `make_solid`."""
    return _SCENES[solid]


def free_unknowns(solid: Any) -> NDArray[np.int64]:
    """The unknowns that are not clamped: those with mass."""
    return np.flatnonzero(solid.mass.getDiagonal().array > 0)


def dense(matrix: Any, keep: NDArray[np.int64]) -> Array:
    """Rows and columns of a PETSc matrix as an array."""
    full = matrix.copy().convert("dense")
    return full.getDenseArray()[np.ix_(keep, keep)]  # a copy, made while the matrix lives


def random_field(solid: Any, size: float, seed: int = 0) -> Array:
    """A rough field with entries of a given size, zero on the clamped unknowns."""
    field = np.zeros(solid.local)
    keep = free_unknowns(solid)
    field[keep] = size * np.random.default_rng(seed).standard_normal(keep.size)
    return field


def enriched(
    solid: Any, method: str = "rubin", modes: int = 1, wanted: Any = None
) -> tuple[Any, Any, Any]:
    """Modes, derivatives (all unless given by label) and basis of a solid."""
    from fenicsrom.reduction.basis import build_basis
    from fenicsrom.reduction.derivatives import all_pairs, modal_derivatives
    from fenicsrom.reduction.modes import component_modes

    found = component_modes(solid, Basis(method=method, modes=modes))
    labels = all_pairs(found.labels) if wanted is None else list(wanted)
    theta = modal_derivatives(
        found.vectors, found.labels, labels, solid.tangent_derivative, found.inverse
    )
    vectors = np.concatenate([found.normal, theta], axis=1)
    basis = build_basis(solid, found, vectors, [*found.labels[:modes], *labels])
    return found, theta, basis


def unexplained(columns: Iterable[str], file: str) -> list[str]:
    """The columns of a file that `demos/files.md` does not explain.

    A word in capitals there stands for any text.
    """
    page = (Path(__file__).parents[1] / "demos" / "files.md").read_text()
    section = page.partition(f"\n`{file}` has a row")[2].partition("\n`")[0]
    cells = [row.split("|")[1] for row in section.splitlines() if row.startswith("|")]
    names = [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]
    patterns = [re.sub("[A-Z]+(?=_m)", ".+", name) for name in names]
    return [name for name in columns if not any(re.fullmatch(each, name) for each in patterns)]


# ------------------------------------------------------------------ small models


def harmonic(amplitude: ArrayLike, omega: ArrayLike, phase: ArrayLike) -> LoadHistories:
    """One sine for each load, amplitude sin(omega t + phase); (loads,) N, rad/s, rad."""
    columns = np.broadcast_arrays(*np.atleast_1d(amplitude, omega, phase))
    return _joined([([_sine(*map(float, row))], []) for row in zip(*columns, strict=True)])


NO_LOADS = harmonic(np.zeros(0), np.zeros(0), np.zeros(0))


def first(masters: int, n: int, dimension: int = 2) -> tuple[ContactPoints, Array, Array]:
    """Contact points whose displacements are the first coordinates, with their rows and offsets."""
    d = dimension if masters % dimension == 0 else masters
    count = masters // d if masters else 0
    where = ContactPoints(
        np.arange(count), np.ones(count), np.zeros((count, d)), np.tile(np.eye(d), (count, 1, 1))
    )
    return where, np.eye(masters, n), np.zeros(masters)


def linear_model(
    mass: Any,
    stiffness: Any,
    *,
    damping: float = 0.0,
    loads: Any = None,
    load_histories: LoadHistories = NO_LOADS,
    masters: int = 0,
) -> ReducedModel:
    """A linear model of dense matrices; its first coordinates are its contact displacements and its
    probe."""
    mass, stiffness = np.atleast_2d(mass), np.atleast_2d(stiffness)
    n = mass.shape[0]
    elastic = ElasticPolynomial(np.zeros(n), stiffness, np.zeros((0, 0)), np.zeros((0, 0)))
    loads = np.zeros((n, 0)) if loads is None else np.asarray(loads, float).reshape(n, -1)
    contact = first(masters, n)
    d = contact[0].frame.shape[2]
    return reduced_model(
        mass, damping, elastic, loads, load_histories, *contact, np.eye(d, n), np.zeros(d)
    )


def loaded_duffing(
    damping: float, cubic: float, load: LoadHistories, gain: float = 1.0, linear: float = 1.0
) -> ReducedModel:
    """q'' + damping q' + linear q + cubic q^3 = load; the probe moves along x by gain times q."""
    one = np.ones((1, 1))
    elastic = ElasticPolynomial(np.zeros(1), linear * one, 0.0 * one, 3.0 * cubic * one)
    return reduced_model(
        one, damping, elastic, one, load, *first(0, 1), gain * np.eye(2, 1), np.zeros(2)
    )


def duffing(
    damping: float, cubic: float, force: float, omega: float, linear: float = 1.0
) -> tuple[ReducedModel, float]:
    """x'' + damping x' + linear x + cubic x^3 = force cos(omega t), and the period of the load."""
    load = harmonic(np.array([force]), np.array([omega]), np.array([0.5 * np.pi]))
    return loaded_duffing(damping, cubic, load, linear=linear), 2.0 * np.pi / omega


def uncoupled(scene: Scene, *squares: float) -> ReducedModel:
    """A linear model of up to two coordinates with the load and the damping of a scene.

    Args:
        scene: its loads and its mass-proportional damping.
        squares: of the natural frequencies in rad/s.
    """
    return linear_model(
        np.eye(len(squares)),
        np.diag(squares),
        damping=scene.material.mass_damping,
        loads=[[1.0], [0.3]][: len(squares)],
        load_histories=load_histories(scene),
    )


def excited_stiffness(damping: float, coupling: float, load: LoadHistories) -> ReducedModel:
    """A shaken mode x and a mode y that x excites through its stiffness.

    x'' + d x' + 4 x + c x y^2 = load and y'' + d y' + (1 + c x^2) y = 0.
    """
    cubic = np.zeros((3, 3))  # of the pairs xx, xy, yy
    cubic[0, 2] = cubic[2, 0] = coupling
    cubic[1, 1] = 2.0 * coupling
    return reduced_model(
        np.eye(2),
        damping,
        ElasticPolynomial(np.zeros(2), np.diag([4.0, 1.0]), np.zeros((3, 2)), cubic),
        np.array([[1.0], [0.0]]),
        load,
        *first(0, 2),
        np.eye(2),
        np.zeros(2),
    )


def oscillator(
    steps: int = 40, force: float = 1.0, damping: float = 0.5
) -> tuple[ReducedModel, Scene, Motion]:
    """A linear oscillator of two coordinates, shaken, marched until it is steady."""
    scene = beam_scene(
        2,
        (
            "loads.0.frequency=1.0",
            f"loads.0.force={force}",
            "time.steady='march'",
            f"material.mass_damping={damping}",
        ),
        contacts=None,
        probe={"group": "tip"},
        geometrically_nonlinear=False,
    )
    # fewer steps than a scene file allows, too
    scene = replace(scene, time=scene.time.changed(steps_per_period=steps))
    model = linear_model(
        np.eye(2),
        np.diag([60.0, 30.0]),
        damping=damping,
        loads=[[1.0], [0.3]],
        load_histories=load_histories(scene),
    )
    return model, scene, simulate(model, scene)


def random_polynomial(
    n: int, dimension: int = 2, seed: int = 0, points: int = 40
) -> ElasticPolynomial:
    """The elastic polynomial of random displacement gradients: of an imagined body, but positive
    and conservative."""
    rng = np.random.default_rng(seed)
    gradients = rng.standard_normal((points, 1 + n, dimension, dimension))
    gradients[:, 0] = 0.0
    weights = rng.uniform(0.5, 1.5, points) / points
    tensor = isotropic_tensor(1.0, 0.8, dimension)
    return elastic_polynomial(strain_products([(weights, gradients)], tensor, n), n)


def isotropic_tensor(lame: float, shear: float, dimension: int) -> Array:
    """The elasticity tensor of λ and μ in Mandel's notation."""
    trace = np.repeat([1.0, 0.0], [dimension, dimension * (dimension - 1) // 2])
    return np.asarray(2.0 * shear * np.eye(trace.size) + lame * np.outer(trace, trace))


def isotropic_material(lame: float, shear: float) -> Material:
    """The material of λ and μ."""
    young = shear * (3.0 * lame + 2.0 * shear) / (lame + shear)
    return Material(young=young, poisson=0.5 * lame / (lame + shear), density=1.0)


def random_model(
    n: int,
    *,
    seed: int = 0,
    damping: float = 0.0,
    masters: int = 0,
    force: float = 0.0,
    omega: float = 1.0,
) -> ReducedModel:
    """A nonlinear model with a random mass matrix and polynomial, one load on all coordinates."""
    rng = np.random.default_rng(seed + 1)
    root = rng.standard_normal((n, n))
    mass = np.eye(n) + 0.2 * root @ root.T
    load_histories = harmonic(np.array([force]), np.array([omega]), np.array([0.3]))
    loads = rng.uniform(0.5, 1.0, (n, 1))
    elastic = random_polynomial(n, seed=seed)
    return reduced_model(
        mass, damping, elastic, loads, load_histories, *first(masters, n), np.eye(2, n), np.zeros(2)
    )


def one_contact(dimension: int = 2, **values: Any) -> Contacts:
    """Parameters of one contact point before a plane, or of several if a value is a list."""
    given = {
        "preload": 0.0,
        "gap": 0.0,
        "normal_stiffness": 1.0,
        "tangential_stiffness": 1.0,
        "friction": 0.0,
    } | values
    arrays = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(value, float)) for value in given.values())
    )
    return planes(
        **{name: array.copy() for name, array in zip(given, arrays, strict=True)},
        dimension=dimension,
    )


def fixed_steps(scheme: str, steps: int, duration: float = 1.0, radius: float = 0.8) -> Time:
    """Settings of a run of a number of equal steps."""
    return Time.of(
        scheme=scheme, duration=float(duration), step=duration / steps, spectral_radius=radius
    )


def period_steps(steps: int, scheme: str = "discrete-gradient") -> Time:
    """Settings of a periodic motion with a number of equal steps per period."""
    return Time.of(scheme=scheme, periods=1, steps_per_period=steps)


# ------------------------------------------------------------------ ranks

needs_mpirun = pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")


@contextmanager
def refusal(
    kind: ErrorKind, key: str = "", file: str = "", names: str = ""
) -> Iterator[pytest.ExceptionInfo[SceneError]]:
    """Expect a `SceneError` in one line; the body may look at it afterwards.

    Args:
        kind: its kind.
        key: the key that it is about.
        file: the name of the file that it is about; by default any file.
        names: text that its message contains, such as a name that stands in the file.
    """
    with pytest.raises(SceneError) as caught:
        yield caught
    error = caught.value
    assert (error.kind, error.key) == (kind, key), error
    assert not file or (Path(error.source).name == file and error.source in str(error))
    assert names in str(error) and "\n" not in str(error)


def on_ranks(
    ranks: int, *command: str, code: int = 0, timeout: float = 900.0
) -> subprocess.CompletedProcess[str]:
    """Run a Python command on some ranks, where it finds this program and these tests.

    Commands that succeed on one or two ranks share ranks that wait for them: to import dolfinx
    costs more than most of them.

    Args:
        ranks: how many; without mpirun if one.
        command: what follows `python3`: `-c SCRIPT ..` or `-m MODULE ..`.
        code: that it must end with.
        timeout: after which the ranks hang, s; a loaded machine is ten times slower.
    """
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX", "PRTE"))
    }
    paths = [
        str(Path(fenicsrom.__file__).parents[1]),
        *(str(Path(__file__).parent / name) for name in ("", "fem", "online")),
        os.environ.get("PYTHONPATH", ""),
    ]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    # a rank that waits leaves the processor to others: two ranks may share one
    environment.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")
    if ranks < 3 and code == 0:
        done = _waiting_ranks(ranks, environment).run(command, timeout)
    else:
        done = subprocess.run(
            ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, *command],
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    assert done.returncode == code, done.stderr
    return done


def fresh_python(
    program: str, *arguments: str, code: int = 0, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program in a Python process of its own, which ends with a code."""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    return done


_WAITING: dict[int, Ranks] = {}


def _waiting_ranks(number: int, environment: dict[str, str]) -> Ranks:
    """Ranks that run the commands of all tests of this process; they end with it."""
    if number not in _WAITING:
        folder = Path(tempfile.mkdtemp(prefix="ranks"))
        ranks = _WAITING[number] = Ranks(number, folder, environment)
        atexit.register(shutil.rmtree, folder)
        atexit.register(ranks.end)
    return _WAITING[number]


def arrays_of_one_and_two_ranks(
    script: str, folder: Path, *arguments: str
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Run a script on one and on two ranks; give the arrays that each run writes.

    Args:
        script: Python code that writes an .npz file, whose name follows the arguments; its array
            "ranks" holds the number of ranks.
        folder: folder of the files.
        arguments: the arguments of the script.
    """
    found = []
    for ranks in (1, 2):
        target = folder / f"{ranks}.npz"
        on_ranks(ranks, "-c", script, *arguments, str(target))
        with np.load(target) as file:
            found.append({name: file[name] for name in file.files})
        assert int(found[-1].pop("ranks")) == ranks
    return found[0], found[1]


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """A quiet gmsh session of the test itself."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


def step_file(path: Path, build: Callable[[Any], Any]) -> Path:
    """A .step file in millimetres of a body that `build` makes with gmsh's CAD kernel."""
    with gmsh_session() as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


def rubbing_masses(
    preload: float = 0.4, friction: float = 0.4, damping: float = 0.1
) -> tuple[ReducedModel, Contacts, float]:
    """Coupled masses, the first in front of a wall with friction; and the period of their load."""
    model = linear_model(
        np.eye(4),
        np.diag([1.0, 2.0, 3.0, 4.0]) + 0.3 * np.ones((4, 4)),
        damping=damping,
        loads=np.array([[0.8], [1.2], [-0.5], [0.7]]),
        load_histories=harmonic(np.array([3.0]), np.array([1.3]), np.array([0.3])),
        masters=2,
    )
    contacts = one_contact(
        preload=preload, normal_stiffness=6.0, tangential_stiffness=5.0, friction=friction
    )
    return model, contacts, 2.0 * np.pi / 1.3


@contextmanager
def heard(hear: Callable[[str], None]) -> Iterator[None]:
    """Pass the messages of the logger `fenicsrom` in the body to a function."""
    handler = logging.Handler(logging.INFO)
    handler.emit = lambda record: hear(record.getMessage())  # type: ignore[method-assign]
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(logging.NOTSET)


def no_contacts(dimension: int = 2) -> Contacts:
    """The contacts of a scene that has none."""
    return planes(*np.zeros((5, 0)), dimension=dimension)


def rubbing_beam(
    loads: list[dict[str, Any]], nonlinear: bool, periods: int, pressed: bool = True
) -> Scene:
    """The scene of a small beam whose tip touches a stiff wall, or stands far from it."""
    touch = {
        "group": "tip",
        "at": "centre",
        "normal": [1.0, 0.0],
        **({"preload": 5e3} if pressed else {"gap": 10.0}),
        "friction": 0.4,
        "normal_stiffness": 2e8,
        "tangential_stiffness": 1e7,
    }
    sizes = (*STOCKY, "geometry.parameters.elements_along=2", "geometry.parameters.height=0.05")
    return beam_scene(
        2,
        (*sizes, f"geometrically_nonlinear={str(nonlinear).lower()}"),
        loads=loads,
        contacts=[touch],
        time={"periods": periods, "steps_per_period": 60, "steady_tolerance": 0},
    )


def motions_of_all_unknowns(
    loads: list[dict[str, Any]], nonlinear: bool = True
) -> tuple[Motion, Motion]:
    """Motions of a small beam that slips and lifts off at its tip, whose reduced coordinates are
    all its unknowns, those of the contact first: of the reduced and of the full model."""
    from fenicsrom.fem.full.full import full_model
    from fenicsrom.reduction.basis import ReducedBasis, project

    scene = rubbing_beam(loads, nonlinear, periods=2)
    solid = make_solid(scene)
    node = [int(np.argmax(row)) for row in solid.contact_rows.toarray()]
    order = [*node, *[k for k in free_unknowns(solid) if k not in node]]
    identity = np.zeros((solid.local, len(order)))
    identity[order, range(len(order))] = 1.0
    basis = ReducedBasis("rubin", identity, tuple(map(str, order)), 2, {}, 1.0)
    return simulate(project(solid, basis, nonlinear), scene), simulate(full_model(solid), scene)


def assert_same_motion(one: Motion, other: Motion, tolerance: float) -> None:
    """Motions of 120 steps with slip and lift-off agree in displacements, states and energies."""
    assert one.steps == other.steps == 120 and {-1, 0} <= set(one.state.ravel())
    size = np.abs(one.displacement).max(axis=0)
    np.testing.assert_allclose(
        one.displacement / size, other.displacement / size, rtol=0, atol=tolerance
    )
    np.testing.assert_array_equal(one.state, other.state)
    for name in ("kinetic", "elastic", "work", "friction_dissipation"):
        a, b = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-5 * np.abs(a).max())

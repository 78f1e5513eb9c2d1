"""Functional Mock-up Units of reduced models: their description, their C source, and in FMPy."""

from __future__ import annotations

import ctypes
import subprocess
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from support import beam_scene, random_model, random_polynomial

import fenicsrom.exchange.fmu as exchange
from fenicsrom.exchange.export import export
from fenicsrom.online.model.matrices import ModelArrays, model_arrays
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel

N, M = 3, 2
EXACT = {"rtol": 1e-11, "atol": 1e-12}


def stored_model(**changes: Any) -> StoredModel:
    """A nonlinear model of three coordinates, with a contact and a gyroscopic matrix."""
    scene = beam_scene(2, ("contacts.0.at='mean'", "loads.0.at='mean'", "basis.modes=1"))
    skew = np.triu(np.ones((N, N)), 1)
    model = random_model(N, masters=M)._replace(
        load_histories=load_histories(scene),
        damping=0.5,
        velocity_matrix=skew - skew.T + 0.1 * np.eye(N),
        **changes,
    )
    return StoredModel(model, scene, "rubin", ("1V", "1S", "2S"), 9, np.array([3.6]), {})


class Unit:
    """The compiled source of a unit, called as the standard says."""

    def __init__(self, path: Path, folder: Path):
        with zipfile.ZipFile(path) as unit:
            self.files = unit.namelist()
            self.xml = ElementTree.fromstring(unit.read("modelDescription.xml"))
            (folder / "model.c").write_bytes(unit.read("sources/model.c"))
        words = ["gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
        subprocess.run([*words, "-o", "model.so", "model.c"], cwd=folder, check=True)
        self.library = ctypes.CDLL(str(folder / "model.so"))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        guid = self.xml.attrib["guid"].encode()
        self.instance = self.start(guid)

    def start(self, guid: bytes) -> Any:
        found = self.library.fmi2Instantiate(b"x", 0, guid, b"", None, 0, 0)
        return None if found is None else ctypes.c_void_p(found)

    @property
    def references(self) -> dict[str, int]:
        variables = self.xml.findall("./ModelVariables/ScalarVariable")
        return {entry.attrib["name"]: int(entry.attrib["valueReference"]) for entry in variables}

    def names(self, name: str, count: int) -> list[str]:
        return [f"{name}[{k + 1}]" for k in range(count)]

    def get(self, names: list[str]) -> np.ndarray:
        refs = (ctypes.c_uint * len(names))(*(self.references[name] for name in names))
        values = np.zeros(len(names))
        size = ctypes.c_size_t(len(names))
        assert self.library.fmi2GetReal(self.instance, refs, size, _at(values)) == 0
        return values

    def set(self, names: list[str], given: Any) -> int:
        refs = (ctypes.c_uint * len(names))(*(self.references[name] for name in names))
        values = np.array(given, dtype=float)
        return int(
            self.library.fmi2SetReal(self.instance, refs, ctypes.c_size_t(len(names)), _at(values))
        )


def _at(values: np.ndarray) -> Any:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> tuple[Unit, ModelArrays]:
    folder, stored = tmp_path_factory.mktemp("fmu"), stored_model()
    written = export(stored, folder / "beam 1.fmu", "fmu")
    assert written.files == (folder / "beam 1.fmu",) and not written.notes
    made = Unit(written.files[0], folder)
    assert "binaries/linux64/beam_1.so" in made.files
    return made, model_arrays(stored.model)


def test_derivatives_and_outputs_of_unit_are_those_of_the_model(
    unit: tuple[Unit, ModelArrays],
) -> None:
    beam, arrays = unit
    rng = np.random.default_rng(4)
    for _ in range(3):
        q, v, contact = 0.3 * rng.standard_normal(N), rng.standard_normal(N), rng.standard_normal(M)
        load = 7.0 * rng.standard_normal(1)
        assert beam.set(beam.names("load", 1), load) == 0
        assert beam.set(beam.names("contact_force", M), contact) == 0
        state, rates = np.array([*q, *v]), np.zeros(2 * N)
        size = ctypes.c_size_t(2 * N)
        assert beam.library.fmi2SetContinuousStates(beam.instance, _at(state), size) == 0
        assert beam.library.fmi2GetDerivatives(beam.instance, _at(rates), size) == 0
        force = arrays.loads @ load - (arrays.damping + arrays.gyroscopic) @ v
        force -= arrays.elastic_force(q) + arrays.contact_rows.T @ contact
        wanted = np.concatenate([v, np.linalg.solve(arrays.mass, force)])
        np.testing.assert_allclose(rates, wanted, **EXACT)
        slopes = [f"der({name}[{k + 1}])" for name in "qv" for k in range(N)]
        np.testing.assert_allclose(beam.get(slopes), wanted, **EXACT)
        np.testing.assert_allclose(
            beam.get(beam.names("contact_displacement", M)), arrays.contact_displacement(q), **EXACT
        )
        np.testing.assert_allclose(
            beam.get(beam.names("contact_velocity", M)), arrays.contact_rows @ v, **EXACT
        )
        np.testing.assert_allclose(
            beam.get(beam.names("probe", 2)), arrays.probe_offset + arrays.probe_rows @ q, **EXACT
        )


def test_variables_of_unit_say_what_they_are(unit: tuple[Unit, ModelArrays]) -> None:
    beam, _ = unit
    variables = beam.xml.findall("./ModelVariables/ScalarVariable")
    assert [int(entry.attrib["valueReference"]) for entry in variables] == [*range(len(variables))]
    assert beam.xml.find("ModelExchange").attrib["modelIdentifier"] == "beam_1"
    for index, entry in enumerate(variables):
        if (number := entry[0].attrib.get("derivative")) is not None:
            state = variables[int(number) - 1].attrib["name"]
            assert entry.attrib["name"] == f"der({state})", index
    listed = {
        name: [int(k.attrib["index"]) for k in beam.xml.findall(f"./ModelStructure/{name}/*")]
        for name in ("Outputs", "Derivatives", "InitialUnknowns")
    }
    outputs = [k for k, v in enumerate(variables, 1) if v.attrib["causality"] == "output"]
    assert listed["Outputs"] == outputs and len(listed["Derivatives"]) == 2 * N
    assert listed["InitialUnknowns"] == sorted(outputs + listed["Derivatives"])


def test_unit_of_a_linear_model_without_contact_starts_with_its_static_load(tmp_path: Path) -> None:
    loads = [
        {"group": "load", "direction": [0.0, 1.0], "force": 5.0, "frequency": 2.0},
        {"group": "tip", "direction": [0.0, 1.0], "force": -3.0},
    ]
    scene = beam_scene(2, ("geometrically_nonlinear=false",), contacts=None, loads=loads)
    model = random_model(N)
    linear = random_polynomial(N)._replace(quadratic=np.zeros((0, 0)), cubic=np.zeros((0, 0)))
    model = model._replace(elastic=linear, load_histories=load_histories(scene), loads=np.eye(N, 2))
    stored = replace(stored_model(), model=model, scene=scene)
    beam = Unit(export(stored, tmp_path / "a.fmu", "fmu").files[0], tmp_path)
    arrays = model_arrays(model)
    assert beam.get(beam.names("load", 2)).tolist() == [0.0, -3.0]
    q = [0.1, 0.2, -0.4]
    beam.set(beam.names("q", N), q)
    force = arrays.loads @ [0.0, -3.0] - arrays.elastic_force(np.array(q))
    found = beam.get([f"der(v[{k + 1}])" for k in range(N)])
    np.testing.assert_allclose(found, np.linalg.solve(arrays.mass, force), **EXACT)


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(exchange.shutil, "which", lambda name: None)
    yield


def test_unit_without_compiler_holds_its_source_and_says_so(
    no_compiler: None, tmp_path: Path
) -> None:
    written = export(stored_model(), tmp_path / "a.fmu", "fmu")
    assert len(written.notes) == 1
    with zipfile.ZipFile(written.files[0]) as unit:
        assert unit.namelist() == ["modelDescription.xml", "sources/model.c"]


def test_unit_moves_in_fmpy_as_the_model(tmp_path: Path) -> None:
    """Reference: motion of an exported Functional Mock-up Unit | FMPy 0.3.32; scipy | its motion |
    agrees | 1e-6
    """
    fmpy = pytest.importorskip(
        "fmpy", reason="fmpy is not installed; pip install fmpy in docker/run sh -c '...'"
    )
    from fmpy.validation import validate_fmu
    from scipy.integrate import solve_ivp

    stored = stored_model()
    arrays = model_arrays(stored.model)
    path = str(export(stored, tmp_path / "beam.fmu", "fmu").files[0])
    assert validate_fmu(path) == []
    found = fmpy.simulate_fmu(
        path,
        stop_time=3.0,
        output_interval=0.01,
        relative_tolerance=1e-9,
        start_values={"load[1]": 2.0, "contact_force[1]": 0.3, "q[2]": 0.1},
        output=["probe[1]", "probe[2]"],
    )

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        force = arrays.loads[:, 0] * 2.0 - (arrays.damping + arrays.gyroscopic) @ y[N:]
        force -= arrays.elastic_force(y[:N]) + 0.3 * arrays.contact_rows[0]
        return np.concatenate([y[N:], np.linalg.solve(arrays.mass, force)])

    start = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
    exact = solve_ivp(rate, (0.0, 3.0), start, rtol=1e-11, atol=1e-13).y[:N, -1]
    ends = [found["probe[1]"][-1], found["probe[2]"][-1]]
    wanted = arrays.probe_offset + arrays.probe_rows @ exact
    np.testing.assert_allclose(ends, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())

"""A reduced model as a Functional Mock-up Unit for model exchange, FMI 2.0.

The unit computes the accelerations

    q'' = M^-1 (L s − (C + Γ) q' − f(q) − Bc^T F)    (1)

of the n coordinates. Its inputs are the sizes s of the loads and the forces F of the contact
points. Its outputs are the displacements and velocities of the contact points in their local frames
[normal, tangents], and the displacement of the probe. The program that runs the unit has the
contact law, the load histories and the time integration. The unit holds C source that needs the
standard library alone, and its binary for this computer if there is a C compiler. The unit has no
events. Its variables are numbered as in the table of blocks in its source.
"""

import hashlib
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.exchange.matrix_set import polynomial
from fenicsrom.files import atomic_write
from fenicsrom.online.model.matrices import ModelArrays
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import scene_heading

SOURCE = Path(__file__).with_name("fmu.c")
"""The C source of all units; `@DATA@` stands for the sizes and arrays of a model."""

COMPILER_SECONDS = 600
"""A compiler that takes longer is stopped."""

PLATFORMS = {"Linux": ("linux64", ".so"), "Darwin": ("darwin64", ".dylib")}
"""Folder of a binary and the suffix of its file, by the operating system, with 64 bits."""


def write_fmu(path: Path, stored: StoredModel, arrays: ModelArrays) -> bool:
    """Write a unit.

    Args:
        path: the file.
        stored: the model.
        arrays: its arrays.

    Returns:
        Whether the unit has a binary for this computer.

    Raises:
        OSError: the file cannot be written.
    """
    identifier = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    identifier = identifier if identifier[:1].isalpha() else f"model_{identifier}"
    data = _data(arrays, stored)
    guid = hashlib.sha256(data.encode()).hexdigest()[:32]
    source = SOURCE.read_text(encoding="utf-8")
    source = source.replace("@DATA@", f'#define GUID "{guid}"\n{data}')
    binary = _compiled(source)
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w") as unit:
        description = "\n".join([*_description(stored, arrays, identifier, guid), ""])
        unit.writestr("modelDescription.xml", description, zipfile.ZIP_DEFLATED)
        unit.writestr("sources/model.c", source, zipfile.ZIP_DEFLATED)
        if binary is not None:
            folder, suffix = PLATFORMS[platform.system()]
            name = f"binaries/{folder}/{identifier}{suffix}"
            unit.writestr(name, binary, zipfile.ZIP_DEFLATED)
    return binary is not None


def _data(arrays: ModelArrays, stored: StoredModel) -> str:
    """The sizes and arrays of a model in C."""
    coefficients = polynomial(arrays, stored.model.linear)[1]
    n, terms = coefficients.shape
    contacts, probe = len(arrays.contact_offset), len(arrays.probe_offset)
    loads = arrays.loads.shape[1]
    sizes = {"N": n, "K": loads, "M": contacts, "D": probe, "TERMS": terms}
    right = [coefficients, arrays.damping + arrays.gyroscopic, arrays.loads, arrays.contact_rows.T]
    over = np.linalg.solve(arrays.mass, np.hstack(right))
    ends = np.cumsum([terms, n, loads])
    named = dict(zip("ACPG", np.split(over, ends, axis=1), strict=True))
    named |= {
        "ROWS": arrays.contact_rows,
        "OFFSET": arrays.contact_offset,
        "PROBE_ROWS": arrays.probe_rows,
        "PROBE_OFFSET": arrays.probe_offset,
        "START": np.array(_load_sizes(stored)),
    }
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    return "\n".join([*lines, *(_c_array(name, array) for name, array in named.items()), ""])


def _load_sizes(stored: StoredModel) -> list[float]:
    """The sizes of the static loads, which the equilibrium needs, and 0 for the others."""
    return [load.size if load.static else 0.0 for load in stored.scene.loads]


def _c_array(name: str, array: Array) -> str:
    """The definition of an array in C; C has no arrays without entries."""
    values = array.ravel() if array.size else np.zeros(1)
    rows = [values[k : k + 4] for k in range(0, len(values), 4)]
    body = ",\n".join("    " + ", ".join(float(value).hex() for value in row) for row in rows)
    return f"static const double {name}[] = {{\n{body}\n}};"


def _compiled(source: str) -> bytes | None:
    """The shared library of a source; None without a compiler that works."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or platform.system() not in PLATFORMS:
        return None
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder) / "model.c", Path(folder) / "model.so"
        code.write_text(source, encoding="utf-8")
        words = [compiler, "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]
        try:
            subprocess.run(
                [*words, "-o", str(library), str(code)],
                check=True,
                capture_output=True,
                timeout=COMPILER_SECONDS,
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return library.read_bytes()


def _variables(stored: StoredModel, arrays: ModelArrays) -> Iterator[tuple[str, str, str]]:
    """Name, attributes and those of the number of each variable, in the order of their numbers."""
    n, contacts = len(arrays.mass), len(arrays.contact_offset)
    inner = 'causality="local" variability="continuous"'
    state, rate = f'{inner} initial="exact"', f'{inner} initial="calculated"'
    given = 'causality="input" variability="continuous"'
    result = 'causality="output" variability="continuous" initial="calculated"'
    for name, unit, unit_of_rate, first in (("q", "m", "m/s", 1), ("v", "m/s", "m/s2", 2 * n + 1)):
        for k in range(n):
            yield f"{name}[{k + 1}]", state, f'unit="{unit}" start="0"'
        for k in range(n):
            yield f"der({name}[{k + 1}])", rate, f'unit="{unit_of_rate}" derivative="{first + k}"'
    for k, size in enumerate(_load_sizes(stored)):
        yield f"load[{k + 1}]", given, f'start="{size!r}"'
    for name, attributes, number in (
        ("contact_force", given, 'unit="N" start="0"'),
        ("contact_displacement", result, 'unit="m"'),
        ("contact_velocity", result, 'unit="m/s"'),
    ):
        for k in range(contacts):
            yield f"{name}[{k + 1}]", attributes, number
    for k in range(len(arrays.probe_offset)):
        yield f"probe[{k + 1}]", result, 'unit="m"'


def _description(
    stored: StoredModel, arrays: ModelArrays, identifier: str, guid: str
) -> Iterator[str]:
    """The lines of modelDescription.xml."""
    n = len(arrays.mass)
    variables = list(_variables(stored, arrays))
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield (
        f'<fmiModelDescription fmiVersion="2.0" modelName="{identifier}" guid="{guid}" '
        f"description={quoteattr(scene_heading(stored.scene))} generationTool="
        '"fenicsrom" variableNamingConvention="structured" numberOfEventIndicators="0">'
    )
    yield (
        f'<ModelExchange modelIdentifier="{identifier}" canGetAndSetFMUstate="true" '
        'canSerializeFMUstate="true" completedIntegratorStepNotNeeded="true">'
        '<SourceFiles><File name="model.c"/></SourceFiles></ModelExchange>'
    )
    yield "<UnitDefinitions>"
    units = {"m": 'm="1"', "m/s": 'm="1" s="-1"', "m/s2": 'm="1" s="-2"'}
    units["N"] = 'kg="1" m="1" s="-2"'
    yield from (f'<Unit name="{name}"><BaseUnit {si}/></Unit>' for name, si in units.items())
    yield "</UnitDefinitions>"
    yield "<ModelVariables>"
    for reference, (name, attributes, number) in enumerate(variables):
        yield (
            f'<ScalarVariable name="{name}" valueReference="{reference}" {attributes}>'
            f"<Real {number}/></ScalarVariable>"
        )
    yield "</ModelVariables>"
    outputs = [k for k, (_, words, _) in enumerate(variables, 1) if 'causality="output"' in words]
    rates = [*range(n + 1, 2 * n + 1), *range(3 * n + 1, 4 * n + 1)]
    yield "<ModelStructure>"
    for name, members in (
        ("Outputs", outputs),
        ("Derivatives", rates),
        ("InitialUnknowns", sorted([*outputs, *rates])),
    ):
        if members:
            unknowns = "".join(f'<Unknown index="{k}"/>' for k in members)
            yield f"<{name}>{unknowns}</{name}>"
    yield "</ModelStructure>"
    yield "</fmiModelDescription>"

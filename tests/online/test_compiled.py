"""Compilation: the supported versions of numba, and the slower path for all others."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import fixed_steps, fresh_python, one_contact, random_model

from fenicsrom.arrays import Array
from fenicsrom.online.kernels import compilation as compiled
from fenicsrom.online.kernels import compilation as emission
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate


def rubbing_motion() -> Motion:
    """A short motion of a nonlinear model that touches and slips."""
    model = random_model(3, seed=5, masters=2, damping=0.2, force=2.0, omega=1.1)
    contacts = one_contact(
        preload=0.3, normal_stiffness=5.0, tangential_stiffness=8.0, friction=0.6
    )
    return integrate(Problem(model, contacts, fixed_steps("discrete-gradient", 60, 12.0), None))


@pytest.mark.parametrize(
    ("version", "supported"),
    [
        ("0.60.2", False),
        ("0.61.0", True),
        ("0.61.2+dfsg", True),
        ("0.65.0rc1", True),
        ("0.69.0", False),
        ("1.0", False),
        ("unknown", False),
    ],
)
def test_version_of_numba_is_supported_between_its_bounds(version: str, supported: bool) -> None:
    assert emission.is_checked(version) == supported


LOOP = "fenicsrom.online.step.step"
DERIVATIVES = "fenicsrom.online.derivative.period_sensitivity"


def stale_modules(changed: str, sources: dict[str, str]) -> set[str]:
    """The modules whose stored machine code is stale after a change of one module."""
    new = {**sources, changed: sources[changed] + "# changed\n"}
    return {name for name in sources if compiled.stamp(name, new) != compiled.stamp(name, sources)}


@pytest.mark.parametrize(
    ("changed", "stale"),
    [
        ("contact.friction", {LOOP, DERIVATIVES}),
        ("contact.state", {LOOP, DERIVATIVES}),
        ("model.model", {LOOP, DERIVATIVES}),
        ("step.state", {LOOP, DERIVATIVES}),
        ("derivative.period_sensitivity", {DERIVATIVES}),
        ("periodic.shooting", set()),
    ],
)
def test_stored_code_is_stale_where_a_module_it_calls_has_changed(
    changed: str, stale: set[str]
) -> None:
    sources = compiled.read_sources()
    found = stale_modules(f"{compiled.PACKAGE}.{changed}", sources)
    assert {LOOP, DERIVATIVES} & found == stale


IMPORTS = {
    "module": "from fenicsrom.online.contact.law import force\n",
    "package": "from fenicsrom.online.contact import law\n",
    "several": "from fenicsrom.online.contact import (\n    state,\n    law as contact_law,\n)\n",
    "whole": "import fenicsrom.online.contact.law\n",
    "inside": "def f():\n    from fenicsrom.online.contact import law\n",
    "indirect": "from fenicsrom.online.several import force\n",
    "none": "import fenicsrom.online.contact.lawful\n",
}


def test_stored_code_is_stale_after_a_change_in_a_sub_package(tmp_path: Path) -> None:
    for place in (*compiled.TYPES, "contact.__init__", "contact.state", "contact.law", *IMPORTS):
        path = tmp_path.joinpath(*place.removeprefix(compiled.PACKAGE + ".").split("."))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.with_suffix(".py").write_text(IMPORTS.get(place, f"# {place}\n"))
    sources = compiled.read_sources(tmp_path)
    users = {f"{compiled.PACKAGE}.{name}" for name in IMPORTS} - {f"{compiled.PACKAGE}.none"}
    law, package = f"{compiled.PACKAGE}.contact.law", f"{compiled.PACKAGE}.contact"
    assert stale_modules(law, sources) == users | {law}
    for name in ("package", "several", "inside", "indirect"):  # a package may import its names
        assert f"{compiled.PACKAGE}.{name}" in stale_modules(package, sources)


FALLBACK = """
import sys
import numba
numba.__version__ = "0.99.0"
sys.path[:0] = sys.argv[1:3]
from fenicsrom.online.kernels.compilation import ENTRY
from fenicsrom.online.step.step import compiled_march
from test_compiled import rubbing_motion
assert "pipeline_class" not in ENTRY
rubbing_motion().displacement.tofile(sys.argv[3])
assert sum(compiled_march.entry.stats.cache_hits.values()) == int(sys.argv[4])
"""


@pytest.mark.slow
@pytest.mark.long
def test_unknown_version_of_numba_gives_the_same_motion_and_stores_its_kernels(
    tmp_path: Path,
) -> None:
    here = Path(__file__).parent
    path = tmp_path / "displacement"
    expected = rubbing_motion().displacement
    assert np.ptp(expected) > 0.1
    for hits in (0, 1):
        arguments = str(here.parent), str(here), str(path), str(hits)
        fresh_python(FALLBACK, *arguments, NUMBA_CACHE_DIR=str(tmp_path))
        np.testing.assert_array_equal(np.fromfile(path).reshape(expected.shape), expected)


EMITTED = """
import sys
from numba.core.codegen import JITCPUCodegen
emitted, add = [], JITCPUCodegen._add_module
def count(self, module):
    emitted.append(module.name)
    return add(self, module)
JITCPUCodegen._add_module = count
sys.path[:0] = sys.argv[1:3]
from support import one_contact, random_model
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import contact_scratch, zero_contact_state
import numpy as np
at_rest(one_contact(), *np.zeros((2, 1, 2)), 0.0, zero_contact_state(1, 2), contact_scratch(1, 2))
print(sum(at_rest.entry.stats.cache_hits.values()), len(emitted), *emitted)
"""


@pytest.mark.slow
def test_machine_code_is_made_once_for_the_contact_law_and_all_that_it_calls(
    tmp_path: Path,
) -> None:
    """Two processes start at once: one compiles, and the other one loads what it stored."""
    here = Path(__file__).parent
    started = [
        subprocess.Popen(
            [sys.executable, "-c", EMITTED, str(here.parent), str(here)],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    told = sorted(process.communicate()[0].split() for process in started)
    emitted = ["2", "nrt", "at_rest"]  # the first one is numba's own
    assert told == [["0", *emitted], ["1", *emitted]]


def test_error_of_a_compiled_function_is_raised_without_another_compilation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @compiled.compiled
    def root(x: float) -> float:
        if x < 0.0:
            raise ValueError("negative")
        return x**0.5

    assert root(4.0) == 2.0
    monkeypatch.setattr(root.entry, "recompile", lambda: pytest.fail("compiled again"))
    with pytest.raises(ValueError, match="negative"):
        root(-1.0)


@compiled.kernel
def _double(out: Array) -> None:
    out *= 2.0


@compiled.kernel
def _double_or_not(out: Array, yes: bool) -> None:
    if yes:
        _double(out)


def test_part_is_linked_though_one_of_its_callers_never_calls_it() -> None:
    """Each literal has a caller of its own; LLVM drops the call from that of False."""

    @compiled.kernel
    def first_not(out: Array) -> None:
        _double_or_not(out, False)
        _double_or_not(out, True)

    @compiled.kernel
    def last_not(out: Array) -> None:
        _double_or_not(out, True)
        _double_or_not(out, False)

    out = np.ones(2)
    first_not(out)
    last_not(out)
    assert list(out) == [4.0, 4.0]

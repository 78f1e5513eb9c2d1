"""Compilation: the supported versions of numba, and the slower path for all others."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import fixed_steps, one_contact, random_model

from fenicsrom.online.kernels import compiled
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate


def rubbing_motion() -> Motion:
    """A short motion of a nonlinear model that touches and slips."""
    model = random_model(3, seed=5, masters=2, damping=0.2, force=2.0, omega=1.1)
    contacts = one_contact(
        preload=0.3, normal_stiffness=5.0, tangential_stiffness=8.0, friction=0.6
    )
    return integrate(model, contacts, fixed_steps("discrete-gradient", 60, 12.0), None, dimension=2)


@pytest.mark.parametrize(
    ("version", "supported"),
    [
        ("0.60.2", False),
        ("0.61.0", True),
        ("0.61.2+dfsg", True),
        ("0.65.0rc1", True),
        ("0.66.0", False),
        ("1.0", False),
        ("unknown", False),
    ],
)
def test_version_of_numba_is_supported_between_its_bounds(version: str, supported: bool) -> None:
    assert compiled._is_supported(version) == supported


@pytest.mark.parametrize(
    ("changed", "stale"),
    [
        ("friction", {"loop", "period_sensitivity"}),
        ("contact_state", {"loop", "period_sensitivity"}),
        ("model", {"loop", "period_sensitivity"}),
        ("step_sensitivity", {"period_sensitivity"}),
        ("periodic", set()),
    ],
)
def test_stored_code_is_stale_where_a_module_it_calls_has_changed(
    changed: str, stale: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(compiled._FOLDER, tmp_path / "online")
    monkeypatch.setattr(compiled, "_FOLDER", tmp_path / "online")

    def stamp(module: str) -> str:
        return compiled._stamp.__wrapped__(f"fenicsrom.online.{module}")

    before = {module: stamp(module) for module in ("loop", "period_sensitivity")}
    with (tmp_path / "online" / f"{changed}.py").open("a") as file:
        file.write("# changed\n")
    assert {module for module, was in before.items() if stamp(module) != was} == stale


FALLBACK = """
import sys
import numba
numba.__version__ = "0.99.0"
sys.path[:0] = sys.argv[1:3]
from fenicsrom.online.kernels import compiled
from test_compiled import rubbing_motion
assert not compiled.PRIVATE and not compiled.UNCOUNTED
motion = rubbing_motion()
assert compiled.kernel(lambda x: x)._cache.__class__.__name__ == "NullCache"
motion.displacement.tofile(sys.argv[3])
"""


@pytest.mark.slow
def test_unknown_version_of_numba_gives_the_same_motion(tmp_path: Path) -> None:
    here = Path(__file__).parent
    path = tmp_path / "displacement"
    done = subprocess.run(
        [sys.executable, "-c", FALLBACK, str(here.parent), str(here), str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    expected = rubbing_motion().displacement
    assert np.ptp(expected) > 0.1
    np.testing.assert_array_equal(np.fromfile(path).reshape(expected.shape), expected)

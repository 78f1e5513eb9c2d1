"""Contact forces along given periodic paths, against closed forms, and their derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import assert_tangent, one_contact, slope

from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.periodic import orbit
from fenicsrom.online.periodic.balance import phasors, step_weights, waves_of
from fenicsrom.online.periodic.orbit import Orbit, periodic_orbit

Array = NDArray[np.float64]


def along(contacts: Contacts, path: Any, instants: int, harmonics: int = 3) -> tuple[Orbit, Array]:
    """The contact along the path with these coefficients (2 H + 1, d), and the waves."""
    waves = waves_of(harmonics, instants)
    x = waves @ path
    found = periodic_orbit(contacts, 0, x, waves, 1.0, np.zeros(x.shape[1]))
    assert found is not None
    return found, waves


def first_harmonic(found: Orbit, waves: Array) -> NDArray[np.complex128]:
    """The first harmonic (d,) of the force, a - i b of a cosine and a sine."""
    return np.asarray(phasors(step_weights(3, len(waves)) @ found.mean)[1])


def of(*rows: Any) -> Array:
    """Coefficients (7, d) of 1, cos, sin, .. , of which the first ones are given."""
    found = np.zeros((7, len(rows[0])))
    found[: len(rows)] = rows
    return found


# N0, N1, phi, loss, first harmonic of the friction (cosine, sine)
YANG_MENQ = [
    (1.0, 0.5, np.pi / 2, 2.984496122239, 0.386750287496, -0.474997310493),
    (1.0, 2.0, np.pi / 4, 3.712623743418, 0.558507017620, -0.590882420605),
    (-0.5, 2.0, np.pi / 3, 1.863781260595, 0.171259410619, -0.296630000466),
]


@pytest.mark.parametrize(("n0", "n1", "phi", "loss", "cosine", "sine"), YANG_MENQ)
def test_friction_under_a_varying_load_tends_to_that_of_yang_and_menq(
    n0: float, n1: float, phi: float, loss: float, cosine: float, sine: float
) -> None:
    """The points open, stick and slip; the error is of second order in the instants."""
    contacts, errors, steps = one_contact(preload=n0, friction=0.5), [], (128, 512, 2048)
    for count in steps:
        path = of([0.0, 0.0], [n1 * np.cos(phi), 2.0], [-n1 * np.sin(phi), 0.0])
        found, waves = along(contacts, path, count)
        told = first_harmonic(found, waves)[1]
        apart = [found.dissipated.sum() - loss, told.real - cosine, -told.imag - sine]
        errors.append(np.abs(apart).max())
    assert slope(1.0 / np.array(steps), errors) > 1.7
    assert errors[-1] < 1e-5


@pytest.mark.parametrize("ratio", [1.05, 3.0])
def test_slider_of_a_circular_path_repeats_in_few_periods(
    ratio: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One is marched, and four are Newton's; a march would still be 10 % off after two periods."""
    monkeypatch.setattr(orbit, "MOST_PERIODS", 6)  # the last one shows that the slider repeats
    limit, stiffness = 0.6, 2.0
    contacts = one_contact(3, preload=2.0, friction=0.3, tangential_stiffness=stiffness)
    r = ratio * limit / stiffness
    found, waves = along(contacts, of([0.0] * 3, [0.0, r, 0.0], [0.0, 0.0, r]), 1024)
    force = first_harmonic(found, waves)[1]
    assert force.real == pytest.approx(limit / ratio, rel=3e-5)
    across = limit * np.sqrt(1.0 - ratio**-2)
    assert abs(force.imag) == pytest.approx(across, rel=1.3e-4)
    assert found.dissipated.sum() == pytest.approx(2.0 * np.pi * across * r, rel=1.5e-4)


@pytest.mark.parametrize("case", ["slips", "lifts", "sticks", "dragged", "in space", "circle"])
def test_derivatives_by_the_path_match_differences(case: str) -> None:
    """Through all periods, also where a point that then sticks was dragged from its rest."""
    rng = np.random.default_rng(1)
    sizes = {"slips": 2.0, "lifts": 2.0, "sticks": 0.1, "dragged": 0.3, "in space": 0.3}
    sizes["circle"], d = 1.0, 3 if case in ("in space", "circle") else 2
    path = 0.05 * rng.standard_normal((7, d))
    path[1, 1] += sizes[case]
    path[2, -1] += 0.5 * sizes[case]
    if case == "lifts":
        path[2, 0] += 1.5
    if case in ("dragged", "in space"):
        path[0, 1] += 0.6
    contacts = one_contact(d, preload=1.0, friction=0.7)

    def forces(moved: Array) -> Any:
        return along(contacts, moved.reshape(d, 7).T, 64)[0].mean.ravel()

    found, _ = along(contacts, path, 64)
    assert found.free == {"sticks": 1, "dragged": 1, "in space": 2}.get(case, 0)
    dragged = np.ptp(found.slider[:, 1]) < 1e-12 and abs(found.slider[0, 1]) > 1e-3
    assert dragged == (case in ("dragged", "in space"))
    slopes = found.slopes.reshape(-1, 7 * d)
    assert_tangent(forces, lambda x: slopes, path.T.ravel(), step=1e-6, tolerance=1e-6)

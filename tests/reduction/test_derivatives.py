"""Static modal derivatives: symmetric, equal to differences, and the curvature of static response
paths."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import free_unknowns

from fenicsrom.reduction.derivatives import all_pairs, modal_derivatives, split
from fenicsrom.scene import Basis

SOLIDS = ["beam2d", "beam3d", "bent2d", "bent3d"]
PAIRS = [*zip(SOLIDS, 2 * ("craig-bampton", "rubin"), strict=True)]


def test_labels_of_derivatives_name_their_pairs() -> None:
    assert all_pairs(["1V", "2V", "1S"]) == ["1V1V", "1V2V", "1V1S", "2V2V", "2V1S", "1S1S"]
    assert all_pairs([]) == []
    assert split("12V3S") == ("12V", "3S")
    for wrong in ("1V", "1V2", "V1V1", "1V1V1V", "1v1v", ""):
        with pytest.raises(ValueError, match="is not the label of a modal derivative"):
            split(wrong)


class Identity:
    def solve(self, block: Any) -> Any:
        return block


def test_derivatives_are_solved_for_given_pairs_in_their_order() -> None:
    seen = []

    def derivative(x: Any, y: Any) -> Any:
        seen.append((x[0], y[0]))
        return x * y

    vectors = np.array([[2.0, 3.0, 5.0]])
    found = modal_derivatives(vectors, ["1V", "2V", "1S"], ["2V1S", "1V1V"], derivative, Identity())
    np.testing.assert_array_equal(found, [[-15.0, -4.0]])
    assert seen == [(5.0, 3.0), (2.0, 2.0)]
    assert modal_derivatives(vectors, ["1V", "2V", "1S"], [], derivative, Identity()).shape == (
        1,
        0,
    )


def component(solid: Any, method: str, modes: int = 2) -> Any:
    from fenicsrom.reduction.modes import component_modes

    return component_modes(solid, Basis(method=method, modes=modes))


@pytest.mark.parametrize(("name", "method"), PAIRS)
def test_derivatives_are_symmetric(name: str, method: str, request: pytest.FixtureRequest) -> None:
    solid = request.getfixturevalue(name)
    found = component(solid, method)
    pairs = [split(label) for label in all_pairs(found.labels)]
    column = dict(zip(found.labels, found.vectors.T, strict=True))
    one, other = (
        np.array([solid.tangent_derivative(column[a], column[b]) for a, b in order]).T
        for order in (pairs, [pair[::-1] for pair in pairs])
    )
    difference = np.linalg.norm(one - other, axis=0)
    assert np.all(difference <= 1e-10 * np.linalg.norm(one, axis=0))
    theta = -found.inverse.solve(one)
    apart = energy(solid, theta + found.inverse.solve(other))
    assert np.all(apart <= 1e-10 * energy(solid, theta))


def energy(solid: Any, block: Any) -> Any:
    """Energy norm of each column."""
    return np.sqrt(np.abs(np.sum(block * solid.stiffness_times(block), axis=0)))


@pytest.mark.parametrize(("name", "method"), PAIRS)
def test_derivatives_match_central_differences(
    name: str, method: str, request: pytest.FixtureRequest
) -> None:
    """The right-hand sides agree to the rounding error of the difference, and the derivatives agree
    in the energy norm. A single entry of a derivative may differ more, because a slender body turns
    the rounding error of a force into bending."""
    solid = request.getfixturevalue(name)
    found = component(solid, method)
    labels = all_pairs(found.labels)
    exact, difference = (
        modal_derivatives(found.vectors, found.labels, labels, rule, found.inverse)
        for rule in (solid.tangent_derivative, solid.tangent_difference)
    )
    column = dict(zip(found.labels, found.vectors.T, strict=True))
    for label in labels:
        a, b = (column[part] for part in split(label))
        rhs = solid.tangent_derivative(b, a)
        assert np.linalg.norm(solid.tangent_difference(b, a) - rhs) <= 1e-10 * np.linalg.norm(
            rhs
        ), label
    assert np.all(energy(solid, exact - difference) <= 1e-7 * energy(solid, exact))


@pytest.mark.parametrize("name", SOLIDS)
def test_derivatives_match_curvature_of_static_paths(
    name: str, request: pytest.FixtureRequest
) -> None:
    """The forces s K X_i + t K X_j cause the displacement u(s, t), with u_st = theta_ij at the
    start."""
    solid = request.getfixturevalue(name)
    found = component(solid, "rubin")
    labels = ["1V1V", "1V2V", "1V1S", "2V2S"]
    theta = modal_derivatives(
        found.vectors, found.labels, labels, solid.tangent_derivative, found.inverse
    )
    column = dict(zip(found.labels, found.vectors.T, strict=True))
    rest = solid.internal_force(solid.equilibrium)
    small = 2e-4 * energy(solid, found.normal[:, :1] / np.abs(found.normal[:, 0]).max())
    for label, derivative in zip(labels, theta.T, strict=True):
        # as much energy in each as in a small motion of the first mode: far from buckling
        scales = [small / energy(solid, column[part][:, None]) for part in split(label)]
        a, b = (scale * column[part] for scale, part in zip(scales, split(label), strict=True))
        scaled = scales[0] * scales[1] * derivative
        forces = solid.stiffness_times(np.stack([a, b], axis=1))

        def place(s: float, t: float, forces: Any = forces) -> Any:
            return solid.static(rest + forces @ [s, t], solid.equilibrium) - solid.equilibrium

        def curvature(h: float, place: Any = place) -> Any:
            return (place(h, h) - place(h, -h) - place(-h, h) + place(-h, -h)) / (4 * h * h)

        fourth_order = (4 * curvature(1.0) - curvature(2.0)) / 3
        assert energy(solid, (fourth_order - scaled)[:, None]) <= 1e-3 * energy(
            solid, scaled[:, None]
        ), label


@pytest.mark.parametrize("name", SOLIDS)
def test_held_derivatives_do_not_move_the_contact(
    name: str, request: pytest.FixtureRequest
) -> None:
    solid = request.getfixturevalue(name)
    found = component(solid, "craig-bampton")
    labels = all_pairs(found.labels)
    theta = modal_derivatives(
        found.vectors, found.labels, labels, solid.tangent_derivative, found.inverse
    )
    column = dict(zip(found.labels, found.vectors.T, strict=True))
    rhs = np.array(
        [solid.tangent_derivative(column[b], column[a]) for a, b in map(split, labels)]
    ).T
    free = np.abs(solid.factor.solve(rhs)).max(axis=0)
    assert np.all(np.abs(solid.contact_rows @ theta).max(axis=0) <= 1e-7 * free)
    # what is out of balance is held by contact forces
    keep, b = free_unknowns(solid), solid.contact_rows.T.toarray()
    balance = solid.stiffness_times(theta) + rhs
    beside = (balance - b @ np.linalg.lstsq(b, balance, rcond=None)[0])[keep]
    assert np.all(np.linalg.norm(beside, axis=0) <= 1e-7 * np.linalg.norm(rhs, axis=0))

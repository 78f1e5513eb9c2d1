"""Reduced models of bodies that touch against the full model."""

from __future__ import annotations

import pytest
from mpi4py import MPI
from test_pairs import struck

import fenicsrom as fr
from fenicsrom.post.base.tables import rows_of
from fenicsrom.post.studies.compare_report import pictures, quantities, sentences


@pytest.mark.slow
def test_estimates_of_a_joint_cover_the_errors_of_each_size() -> None:
    scene = struck(
        60.0,
        time={"duration": 0.03, "step": 2e-4},
        compare={"modes": [3], "derivatives": ["principal"], "sizes": [20, 30]},
    )
    found = fr.compare(scene, MPI.COMM_SELF)
    assert [len(outcome.labels) for outcome in found.outcomes[1:]] == [20, 30]
    for outcome in found.outcomes:
        assert outcome.failure == "" and outcome.offline["interface_vectors"] > 0.0
        true, friction = outcome.error, outcome.errors["friction_dissipation"]
        assert 0.5 * true <= 100.0 * outcome.estimated.probe <= 4.5 * true
        assert friction <= 200.0 * outcome.estimated.dissipation  # twice the estimate
    small, large = (outcome.error for outcome in found.outcomes[1:])
    assert large < 0.1 < 0.3 < small
    row = rows_of(found.outcomes, quantities(found))[1]
    assert row["error_probe_percent"] == small < row["estimated_probe_percent"]
    assert "estimate.png" in [picture.name for picture in pictures(found)]
    assert "amplitude of the probe" in "".join(sentences(found))

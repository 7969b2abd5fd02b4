"""The ladder of candidates and its recorded prices."""

from __future__ import annotations

import tomllib

import pytest

from tripod_doe.joint.models.candidates import JOINT_CANDIDATES, PRICES
from tripod_doe.joint.simulator import simulator


def test_every_candidate_has_a_recorded_price_from_the_cheapest_on():
    """Exact: joint_cost.py --record pairs tables and candidates by their order."""
    recorded = tomllib.loads(PRICES.read_text())
    for table, candidate in zip(recorded.values(), JOINT_CANDIDATES, strict=True):
        assert (table["evaluation_seconds"], table["evaluations"]) == (
            candidate.evaluation_seconds,
            candidate.evaluations,
        )
    assert [candidate.price for candidate in JOINT_CANDIDATES] == sorted(
        candidate.price for candidate in JOINT_CANDIDATES
    )


@pytest.mark.parametrize("candidate", JOINT_CANDIDATES[2:], ids=lambda candidate: candidate.label)
def test_a_candidate_finds_its_tolerance_as_its_model_does_by_itself(candidate):
    """Regression: candidates named a tolerance, with which runs refuse a joint that vibrates instead of following it."""
    alone = simulator.effective({"model": candidate.values["model"]})
    chosen = simulator.effective(dict(candidate.values))
    assert chosen["relative_tolerance"] is alone["relative_tolerance"] is None
    assert chosen["method"] == alone["method"]


@pytest.mark.parametrize(
    ("model", "share"), [("equilibrium", 1), ("kinetostatic", 1), ("rollers", 25), ("needles", 25)]
)
def test_a_run_in_time_is_priced_by_its_cycles(model, share):
    """Regression: a hundred revolutions, which cost 25 times as much, had the price of four."""
    usual, long = (simulator.recorded_price({"model": model, "cycles": cycles}) for cycles in (4, 100))
    assert long == pytest.approx(share * usual)
    assert usual == simulator.recorded_price({"model": model})

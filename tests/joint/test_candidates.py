"""The ladder of candidates and its recorded prices."""

from __future__ import annotations

import tomllib

from tripod_doe.joint.candidates import JOINT_CANDIDATES, PRICES


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

"""The ladder of rungs and its recorded prices."""

from __future__ import annotations

import tomllib

from tripod_doe.joint.ladder import JOINT_LADDER, PRICES


def test_every_rung_has_a_recorded_price_in_the_order_of_the_ladder():
    """Exact: joint_cost.py --record pairs tables and rungs by their order."""
    recorded = tomllib.loads(PRICES.read_text())
    for table, rung in zip(recorded.values(), JOINT_LADDER, strict=True):
        assert (table["evaluation_seconds"], table["evaluations"]) == (rung.evaluation_seconds, rung.evaluations)
    assert [rung.price for rung in JOINT_LADDER] == sorted(rung.price for rung in JOINT_LADDER)

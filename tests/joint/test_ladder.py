"""The ladder of rungs and its recorded prices."""

from __future__ import annotations

import tomllib

from tripod_doe.joint.ladder import JOINT_LADDER, PRICES
from tripod_doe.mechanics import compilation


def test_every_rung_has_a_recorded_price_in_the_order_of_the_ladder():
    """Exact: joint_cost.py --record pairs tables and rungs by their order."""
    recorded = tomllib.loads(PRICES.read_text())
    for table, rung in zip(recorded.values(), JOINT_LADDER, strict=True):
        assert (table["evaluation_seconds"], table["evaluations"]) == (rung.evaluation_seconds, rung.evaluations)
    assert [rung.price for rung in JOINT_LADDER] == sorted(rung.price for rung in JOINT_LADDER)


def test_a_price_is_no_kernel_source(tmp_path, monkeypatch):
    """Prices measured again leave compiled kernels and old results as they are; a change of a model does not."""
    for folder in ("mechanics", "joint"):
        (tmp_path / folder).mkdir()
    (tmp_path / "joint" / "models.py").write_text("one")
    monkeypatch.setattr(compilation, "_PACKAGE", tmp_path)
    before = compilation.kernel_source_hash()
    (tmp_path / "joint" / PRICES.name).write_text("[rollers]")
    assert compilation.kernel_source_hash() == before
    (tmp_path / "joint" / "models.py").write_text("two")
    assert compilation.kernel_source_hash() != before

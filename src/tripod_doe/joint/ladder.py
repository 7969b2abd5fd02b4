"""The rungs that a study with model = "auto" may choose from, from the cheapest to the finest, and what they cost.

Between `rollers` and the full `needles` stand nine needles so thick that they fill the ring, of three spheres: a third
of the price, and mostly within half a percent of the full third order above 6 deg; nine thin needles cost more and miss
more. Left out: fewer spheres on 27 needles cost as much as seven, since eight share a vector register and three need
more iterations; a tolerance of 4e-3 saves a third, but ends as inaccurate at every fifth point.
"""

from __future__ import annotations

from tripod_doe.quantities import Rung, Value

__all__ = ["JOINT_LADDER"]

_SECONDS = {"equilibrium": 1.9e-5, "rollers": 2.7e-5, "nine needles": 6.0e-5, "needles": 1.32e-4}
"""CPU seconds a force evaluation with its share of the solves (a sweep of 360 samples for `equilibrium`), measured with
benchmarks/joint_cost.py on a 2.6 GHz AMD EPYC; only their ratios decide."""

_RING = {"needle_count": 27, "needle_diameter_mm": 2.0, "spheres_per_needle": 7}


def _full(tolerance: float, evaluations: int) -> Rung:
    values: dict[str, Value] = {"model": "needles", **_RING, "relative_tolerance": tolerance}
    return Rung(values, _SECONDS["needles"], evaluations, full=True)


JOINT_LADDER: tuple[Rung, ...] = (
    Rung({"model": "equilibrium", **_RING, "relative_tolerance": 1e-9}, _SECONDS["equilibrium"], 7),
    Rung({"model": "rollers", **_RING, "relative_tolerance": 4e-3}, _SECONDS["rollers"], 5_200),
    Rung(
        {"model": "needles", "needle_count": 9, "needle_diameter_mm": 5.85, "spheres_per_needle": 3,
         "relative_tolerance": 2e-3},
        _SECONDS["nine needles"], 9_400, spare=True,
    ),
    _full(2e-3, 12_700),
    _full(1e-3, 22_800),
    _full(5e-4, 42_000),
)  # fmt: skip
"""Evaluations are those of a run of four revolutions at the reference joint."""

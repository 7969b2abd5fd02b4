"""The rungs that a study with model = "auto" may choose from, from the cheapest to the finest, and what they cost.

What was left out, and why (benchmarks/joint_cost.py and `model = "auto"` over joint angle 4 to 14 deg): fewer spheres
cost as much as seven, since eight share a vector register, and three need more iterations; a tolerance of 4e-3 ends as
inaccurate at one point in five; thicker needles that fill the ring serve the third order no better than nine thin ones.
"""

from __future__ import annotations

from tripod_doe.quantities import Rung

__all__ = ["JOINT_LADDER"]

_SWEEP = 1.9e-5
"""CPU seconds a sweep of `equilibrium`, of 360 samples."""

_ROLLERS, _NEEDLES, _NEEDLE = 2.7e-5, 1.4e-5, 4.4e-6
"""CPU seconds a force evaluation with its share of the solves: rollers; needles, and for each needle a trunnion.
Measured with benchmarks/joint_cost.py on a core of 2.1 GHz; only their ratios decide."""


def _needles(count: int, tolerance: float, evaluations: int, spare: bool = False) -> Rung:
    return Rung(
        {"model": "needles", "needle_count": count, "relative_tolerance": tolerance},
        _NEEDLES + _NEEDLE * count,
        evaluations,
        full=count == 27,
        spare=spare,
    )


JOINT_LADDER: tuple[Rung, ...] = (
    Rung({"model": "equilibrium", "needle_count": 27, "relative_tolerance": 1e-9}, _SWEEP, 7),
    Rung({"model": "rollers", "needle_count": 27, "relative_tolerance": 4e-3}, _ROLLERS, 5_200),
    _needles(9, 2e-3, 12_000, spare=True),
    _needles(27, 2e-3, 12_700),
    _needles(27, 1e-3, 22_800),
    _needles(27, 5e-4, 42_000),
)
"""Evaluations are those of a run of four revolutions at the reference joint."""

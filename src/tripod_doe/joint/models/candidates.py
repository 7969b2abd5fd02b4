"""Candidates for a study with model = "auto", from the cheapest to the finest, with their costs.

Between `rollers` and the full `needles` stand nine needles so thick that they fill the ring, of three spheres: a third
of the cost, and mostly within half a percent of the full third order above 6 deg; nine thin needles cost more and are
less accurate. Left out: fewer spheres on 27 needles cost as much as seven, since eight share a vector register and
three need more iterations. Candidates set an accuracy and no tolerance, so each chooses its tolerance at every point,
and treats vibrating joints as its model does in a study that names it. Nine needles give noisy results: averaging
the noise away would cost more than 27 needles, so their accuracy is 5 %.

The costs are data next to this module. They do not affect the result of a point, so measuring them again neither
compiles the kernels again nor makes old results unusable, as a change of the source would.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from tripod_doe.model_interface import Candidate, Value

PRICES = Path(__file__).with_name("prices.toml")
"""File of the recorded prices: a table for each candidate, from the cheapest to the finest."""

_RING: dict[str, Value] = {"needle_count": 27, "needle_diameter_mm": 2.0, "spheres_per_needle": 7}
_THICK: dict[str, Value] = {"needle_count": 9, "needle_diameter_mm": 5.85, "spheres_per_needle": 3}
_RECORDED: dict[str, dict[str, float]] = tomllib.loads(PRICES.read_text(encoding="utf-8"))


def _candidate(
    name: str, ring: dict[str, Value], model: str, accuracy: float = 0.02, full: bool = False, substitute: bool = False
) -> Candidate:
    values: dict[str, Value] = {"model": model, **ring, "accuracy": accuracy}
    return Candidate(values, _RECORDED[name]["evaluation_seconds"], _RECORDED[name]["evaluations"], full, substitute)


JOINT_CANDIDATES: tuple[Candidate, ...] = (
    _candidate("equilibrium", _RING, "equilibrium"),
    _candidate("kinetostatic", _RING, "kinetostatic"),
    _candidate("rollers", _RING, "rollers"),
    _candidate("nine-needles", _THICK, "needles", accuracy=0.05, substitute=True),
    _candidate("needles", _RING, "needles", full=True),
    _candidate("needles-half-percent", _RING, "needles", accuracy=0.005, full=True),
    _candidate("needles-quarter-percent", _RING, "needles", accuracy=0.0025, full=True),
)

"""Designs: from the factors of a study to its points, one module a method; execution of the points is elsewhere."""

from tripod_doe.study.designs.design_interface import Column, axis_levels, factor_groups
from tripod_doe.study.designs.fast import CURVE_HARMONICS
from tripod_doe.study.designs.multifidelity import (
    SAMPLE,
    most_points,
    most_samples,
    pilot_samples,
    random_factors,
    split_of,
)
from tripod_doe.study.designs.points import Points, make_points, point_bytes, point_count
from tripod_doe.study.designs.registry import FAMILIES, unit_sample
from tripod_doe.study.designs.sampling import salib_problem

__all__ = [
    "CURVE_HARMONICS",
    "FAMILIES",
    "SAMPLE",
    "Column",
    "Points",
    "axis_levels",
    "factor_groups",
    "make_points",
    "most_points",
    "most_samples",
    "pilot_samples",
    "point_bytes",
    "point_count",
    "random_factors",
    "salib_problem",
    "split_of",
    "unit_sample",
]

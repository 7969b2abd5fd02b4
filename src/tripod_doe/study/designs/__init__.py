"""Designs: from the factors of a study to its points, one module a family. All are static and reproducible."""

from tripod_doe.study.designs.columns import Column, Columns, Rows
from tripod_doe.study.designs.families import FAMILIES
from tripod_doe.study.designs.fingerprints import point_keys
from tripod_doe.study.designs.making import make_points, point_bytes, point_count
from tripod_doe.study.designs.multifidelity import (
    SAMPLE,
    most_points,
    most_samples,
    pilot_samples,
    random_factors,
    split_of,
)
from tripod_doe.study.designs.points import Points
from tripod_doe.study.designs.request import axis_levels, factor_groups
from tripod_doe.study.designs.sampled import CURVE_HARMONICS, salib_problem, unit_sample

__all__ = [
    "CURVE_HARMONICS",
    "FAMILIES",
    "SAMPLE",
    "Column",
    "Columns",
    "Points",
    "Rows",
    "axis_levels",
    "factor_groups",
    "make_points",
    "most_points",
    "most_samples",
    "pilot_samples",
    "point_bytes",
    "point_count",
    "point_keys",
    "random_factors",
    "salib_problem",
    "split_of",
    "unit_sample",
]

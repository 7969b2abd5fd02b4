"""Samples: blocks in the order of SALib, distributions that do not depend on neighbours, tails that are refused."""

from __future__ import annotations

import numpy as np
import pytest
from SALib.sample import sobol

from tripod_doe.errors import InputError
from tripod_doe.study.definition.distributions import quantile
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs import make_points, salib_problem, unit_sample
from tripod_doe.study.designs.saltelli import first_order_blocks

TABLES = {name: FactorTable(low=0.0, high=1.0) for name in ("a", "b", "c")}
GROUPED = TABLES | {name: FactorTable(low=0.0, high=1.0, group="both") for name in ("a", "c")}


def test_more_points_than_a_sobol_sequence_has_are_refused():
    with pytest.raises(InputError, match="a Sobol' sequence has 1,073,741,824 points"):
        unit_sample(DesignTable(kind="sobol", samples=2**30 + 1), TABLES)


@pytest.mark.parametrize("tables", [TABLES, GROUPED], ids=["alone", "grouped"])
def test_blocks_of_two_samples_are_those_of_salib(tables):
    """Exact: the first and last point of each of SALib's blocks give the others."""
    whole = sobol.sample(salib_problem(tables), 64, calc_second_order=False, seed=11)
    blocks = whole.reshape(64, -1, 3)
    assert np.array_equal(first_order_blocks(np.hstack([blocks[:, 0], blocks[:, -1]]), tables), whole)


DISTRIBUTIONS = """
[study]
name = "d"
[factors]
torque_n_m = {low = 10, high = 100}
speed_rpm = {distribution = "log-uniform", low = 10, high = 1000}
joint_angle_deg = {distribution = "triangular", low = 1, high = 20, mode = 6}
groove_sliding_friction = {distribution = "truncated-normal", mean = 0.05, std = 0.02, low = 0.01, high = 0.2}
needle_sliding_friction = {distribution = "normal", mean = 0.03, std = 0.001}
needle_count = {low = 20, high = 29}
model = {distribution = "discrete", values = ["rollers", "equilibrium"], weights = [1, 3]}
"""


def test_a_value_does_not_depend_on_the_points_beside_it():
    """Exact: a point that is made again, alone or in another block, has the same fingerprint."""
    factors = parse_study(DISTRIBUTIONS + '[design]\nkind = "sobol"\nsamples = 4').factors
    unit = np.random.default_rng(5).random(10_007)
    for factor in factors.values():
        whole = quantile(factor, unit)
        for part in (slice(1, 2), slice(3, 10), slice(5001, 9002, 7)):
            assert np.array_equal(quantile(factor, unit[part]), whole[part]), factor.parameter.name


def test_a_tail_that_a_parameter_does_not_allow_is_refused_before_any_point_is_made():
    text = DISTRIBUTIONS.replace("std = 0.001", "std = 0.01") + '[design]\nkind = "sobol"\nsamples = 100_000'
    with pytest.raises(InputError, match=r"needle_sliding_friction.*use a truncated-normal distribution"):
        make_points(parse_study(text))

"""Values of candidates under scatter, and their errors."""

import numpy as np
import pytest

from tripod_doe.analyses.optimisation.manufacturing_scatter import Scatter
from tripod_doe.analyses.optimisation.measures import PointValues, _of_constraint, _of_objective
from tripod_doe.analyses.optimisation.optimisation_file import ConstraintTable, ObjectiveTable
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.study.definition.factors import checked_factor
from tripod_doe.study.definition.study_file_schema import FactorTable

JOINTS, SHARE = 256, 0.95
ONE = np.ones(1)


def drawn(seed):
    values = np.random.default_rng(seed).lognormal(size=(1, JOINTS, 1))
    unknown = np.full_like(values, np.nan)
    return PointValues(values, unknown, unknown)


@pytest.mark.parametrize("over", ["min", "mean", "max"])
@pytest.mark.parametrize("high", [True, False])
def test_the_error_of_a_quantile_is_that_of_its_own_side(over, high):
    """Statistics: twice its half width holds a quantile's scatter over many samples; either tail's, whatever `over`."""
    objective = ObjectiveTable(output="x", over=over, goal="minimise" if high else "maximise")
    limit = ConstraintTable(output="x", over=over, **{"high" if high else "low": 1.0})
    for judge in (
        lambda at: _of_objective(at, objective, ONE, SHARE),
        lambda at: _of_constraint(at, limit, ONE, SHARE)[:2],
    ):
        values, errors = np.array([judge(drawn(seed)) for seed in range(200)])[:, :, 0].T
        assert np.median(errors) == pytest.approx(1.96 * values.std(), rel=0.25)


def test_listed_values_scatter_about_a_candidate_by_their_distance_from_their_mean():
    """Regression: they were added to the candidate's value."""
    name = "joint_angle_deg"
    parameter = JOINT_PARAMETERS[name]
    factor = checked_factor(parameter, FactorTable(distribution="discrete", values=[4.9, 5.1]))
    scatter = Scatter({name: factor}, frozenset([name]), {name: parameter})
    apart = scatter.sample(64, 0)[name]
    assert sorted({round(value, 9) for value in apart.tolist()}) == [-0.1, 0.1]


def test_a_value_on_its_limit_but_for_rounding_keeps_it():
    """Regression: "limits are violated (c = 0.5 above 0.5)" at the start of a search over a logarithmic range."""
    values = np.array([0.5000000000000001, 0.5000001])[:, None, None]
    at = PointValues(values, 0 * values, 0 * values)
    far = _of_constraint(at, ConstraintTable(output="c", high=0.5), np.ones(1), 1.0)[2]
    assert far[0] == 0 < far[1]

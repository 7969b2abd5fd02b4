"""Ends of intervals where other unknowns make up for one along a curve."""

from dataclasses import replace

import numpy as np
import pytest
from fit_problems import model_of, one_record, real_rows

from tripod_doe.analyses.fit.estimation.solution import solve

TOP, DEEP = 0.55, 0.03  # where the second unknown does most, and how much that is
DEVIATION, VAGUE = 1e-3, 10.0  # of the first row, and of what is known of the second unknown


@pytest.mark.parametrize(
    "measured", [0.302, *(pytest.param(each, marks=pytest.mark.slow) for each in (0.29, 0.31, 0.3143))]
)
def test_an_interval_reaches_as_far_as_the_others_make_up_for_it(measured):  # exact
    """Regression: from far outside, the other unknown stayed at its bound, and the interval ended where values fit."""
    layout = one_record([(0, 1), (0, 1)])

    def predict(b):
        return np.hstack([b[:, :1] - DEEP * (1 - ((b[:, 1:] - TOP) / TOP) ** 2), b[:, 1:]])

    rows = replace(real_rows(np.array([measured, 0.5]), DEVIATION), along=np.array([DEVIATION, VAGUE]))
    solution = solve(layout, rows, model_of(layout, predict))
    half = 1.96 * DEVIATION
    assert solution.profiles[0].low == pytest.approx(measured - half, abs=0.1 * half)
    assert solution.profiles[0].high == pytest.approx(measured + DEEP + half, abs=0.1 * half)


def test_a_profile_before_a_wall_takes_few_steps():
    """Regression: each went a tenth of the way to the wall; along a bent valley, an interval was a quarter too long."""
    layout = one_record([(0, 1)])

    def predict(b):
        far = b - 0.1
        return 0.0218 * far + 0.0181 * np.maximum(far - 0.02, 0) + 0.17 * np.maximum(far - 0.55, 0)

    solution = solve(layout, real_rows(np.zeros(1), 0.01), model_of(layout, predict))
    own = solution.profiles[0]
    assert own.high == pytest.approx(0.6, abs=0.01)
    assert (own.places > 0.1).sum() <= 5

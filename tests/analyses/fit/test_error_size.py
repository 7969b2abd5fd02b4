"""The size of the model's errors in the records of a fit: what is drawn comes back, and intervals hold."""

import numpy as np
import pytest
from scipy.stats import t

from tripod_doe.analyses.fit.error_size import estimate_error_size
from tripod_doe.analyses.fit.identifiability import covariance_of
from tripod_doe.analyses.fit.least_squares import Descent
from tripod_doe.analyses.fit.misfit import Misfit, Rows

RECORDS, NOISE = 10, 0.01
PRIOR = np.full(2, 0.5), np.full(2, np.inf)
SLOPE = np.stack([np.ones(RECORDS), np.linspace(-1, 1, RECORDS)], axis=1) * (1 + 0.2j)
ALIKE = np.exp(-((np.linspace(0, 3, RECORDS)[:, None] - np.arange(4)) ** 2)) * 0.1


def drawn(random, factor):
    """Records whose model errs by a multiple of what is on record: in each alone, and alike in neighbours."""

    def chance(count):
        return random.standard_normal(count) + 1j * random.standard_normal(count)

    error = factor * (0.1 * chance(RECORDS) + ALIKE @ chance(ALIKE.shape[1]))
    return Rows(
        record=np.arange(RECORDS),
        order=np.full(RECORDS, 3),
        measured=10 + SLOPE @ np.full(2, 0.5) + error + NOISE * chance(RECORDS),
        along=np.full(RECORDS, NOISE),
        across=np.full(RECORDS, NOISE),
        own_error=np.full(RECORDS, 0.1),
        shared=ALIKE.astype(complex),
        free_phase=np.zeros(RECORDS, bool),
        free_sign=np.zeros(RECORDS, bool),
    )


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_the_size_of_errors_comes_back_and_intervals_hold(factor):
    """Exact statistics: within a quarter, as the prior pulls, and 95 % intervals hold in at least 90 % of 80."""
    random, used, sizes, held = np.random.default_rng(7), np.ones(RECORDS, bool), [], []
    place = np.full(2, 0.5)
    best = Descent(place, 10 + SLOPE @ place, SLOPE, 0.0)
    for _ in range(40):
        rows = drawn(random, factor)
        size = estimate_error_size(rows, used, PRIOR, best)
        misfit = Misfit(rows.with_errors_times(size.factor), used, PRIOR)
        compared = misfit.compare(best.prediction, place)
        jacobian = misfit.jacobian(compared, SLOPE)
        off = np.linalg.lstsq(jacobian, compared.residual, rcond=None)[0]
        freedom = misfit.data - 2
        scatter = max(((compared.residual - jacobian @ off) ** 2).sum() / freedom, 1.0)  # as a fit widens intervals
        half = t.ppf(0.975, min(size.freedom, freedom)) * np.sqrt(scatter * np.diag(covariance_of(jacobian)))
        held.append(np.abs(off) <= half)
        sizes.append(size.factor)
    assert np.exp(np.mean(np.log(sizes))) == pytest.approx(factor, rel=0.25)
    assert np.mean(held) >= 0.9


def test_known_errors_have_no_size():
    """Exact: without errors of the model there is nothing to estimate, and chance is normal."""
    rows = drawn(np.random.default_rng(0), 0.0).with_errors_times(0.0)
    place = np.full(2, 0.5)
    size = estimate_error_size(rows, np.ones(RECORDS, bool), PRIOR, Descent(place, 10 + SLOPE @ place, SLOPE, 0.0))
    assert (size.factor, size.freedom) == (1.0, np.inf)

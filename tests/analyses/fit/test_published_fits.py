"""Fits with certified or known answers: values, deviations, and what data cannot tell."""

from __future__ import annotations

import numpy as np
import pytest
from fit_problems import MISRA1A, THURBER, model_of, one_record, real_rows

from tripod_doe.analyses.fit.estimation.solution import solve
from tripod_doe.analyses.fit.estimation.unknowns import Unknown, make_layout


def deviations(solution):
    """Standard deviations of the scalars in their own units, by the curvature at the minimum."""
    layout = solution.problem.layout
    lengths = np.array([layout.unknowns[u].high - layout.unknowns[u].low for u in layout.owner])
    return np.sqrt(np.diag(solution.covariance)) * lengths


def test_misra1a_of_nist():
    """Published numbers: values and residual sum to 1e-4; deviations to the 2 % that differences over 1 % leave."""
    x, y = MISRA1A.T
    layout = one_record([(100, 500), (1e-4, 1e-3)])
    solution = solve(layout, real_rows(y, 0.1), model_of(layout, lambda b: b[:, :1] * (1 - np.exp(-b[:, 1:] * x))))
    assert layout.physical(solution.best.place) == pytest.approx([2.3894212918e2, 5.5015643181e-4], rel=1e-4)
    assert solution.best.cost * 0.1**2 == pytest.approx(1.2455138894e-1, rel=1e-4)
    assert deviations(solution) == pytest.approx([2.7070075241, 7.2668688436e-6], rel=0.02)
    assert solution.verdicts == ("found", "found")


def test_minos_ends_the_intervals_of_misra1a_where_a_fit_does():
    """Referee: iminuit's MINOS walks along the same profiles by another search; ends to 2 % of a half width."""
    iminuit = pytest.importorskip("iminuit")
    x, y = MISRA1A.T
    layout = one_record([(100, 500), (1e-4, 1e-3)])
    solution = solve(layout, real_rows(y, 0.1), model_of(layout, lambda b: b[:, :1] * (1 - np.exp(-b[:, 1:] * x))))
    minuit = iminuit.Minuit(lambda a, b: (((y - a * (1 - np.exp(-b * x))) / 0.1) ** 2).sum(), a=240.0, b=5.5e-4)
    minuit.errordef = solution.allowed
    minuit.migrad()
    minuit.minos()
    for scalar, name in enumerate(("a", "b")):
        error, own = minuit.merrors[name], solution.profiles[scalar]
        ends = layout.unknowns[scalar].physical(np.array([own.low, own.high])) - minuit.values[name]
        assert ends == pytest.approx([error.lower, error.upper], abs=0.02 * error.upper)


@pytest.mark.slow
def test_thurber_of_nist():
    """Published numbers: seven unknowns, within a fifth of their certified deviations."""
    x, y = THURBER.T

    def mobility(b):
        up = b[:, :1] + b[:, 1:2] * x + b[:, 2:3] * x**2 + b[:, 3:4] * x**3
        return up / (1 + b[:, 4:5] * x + b[:, 5:6] * x**2 + b[:, 6:7] * x**3)

    certified = np.array(
        [1288.139680, 1491.0792535, 583.23836877, 75.416644291, 0.96629502864, 0.39797285797, 0.049727297349]
    )
    spread = np.array(
        [4.6647963344, 39.571156086, 28.698696102, 5.5675370270, 0.031333340687, 0.014984928198, 0.0065842344623]
    )
    layout = one_record([(c - 40 * s, c + 30 * s) for c, s in zip(certified, spread, strict=True)])
    solution = solve(layout, real_rows(y, 13.714), model_of(layout, mobility))
    away = (layout.physical(solution.best.place) - certified) / spread
    assert np.abs(away).max() < 0.2  # of a deviation: a descent ends where it gains less
    assert solution.best.cost * 13.714**2 == pytest.approx(5642.7082397, rel=1e-3)
    assert set(solution.verdicts) == {"found"}


@pytest.fixture(scope="module")
def bacteria():
    """Growth of bacteria, mu = mu_max S / (K + S): with small S only mu_max / K is known (Holmberg 1982)."""
    substrate = np.linspace(0.02, 0.3, 12)
    layout = one_record([(0.05, 50), (0.5, 500)])
    truth = 0.5 * substrate / (60.0 + substrate) * 100
    noise = 0.004 * np.random.default_rng(3).standard_normal(substrate.size)
    model = model_of(layout, lambda b: b[:, :1] * 100 * substrate / (b[:, 1:] + substrate))
    return solve(layout, real_rows(truth + noise, 0.004), model)


@pytest.mark.slow
def test_an_unidentifiable_pair_is_a_combination(bacteria):
    """Published: Holmberg (1982) shows that the two constants of Monod's law are not identifiable one by one."""
    assert bacteria.verdicts == ("combination", "combination")
    factors = dict(bacteria.combinations[0].parts)
    rate, half = bacteria.problem.layout.physical(bacteria.best.place)
    assert -factors[1] / factors[0] == pytest.approx(rate / half, rel=0.02)  # along the valley, rate over half stays


def test_what_is_known_before_counts_like_a_measured_value():
    """Exact: chi squared of two values of one number is over one degree of freedom. Regression: over none."""
    unknowns = [Unknown("b", 0.0, 10.0, mean=4.0, std=0.3)]
    layout = make_layout(unknowns, ["data"], [[""]])
    solution = solve(layout, real_rows(np.array([6.0]), 0.4), model_of(layout, lambda b: b[:, :1]))
    assert solution.freedom == 1
    assert solution.best.cost == solution.scatter == pytest.approx(2**2 / (0.3**2 + 0.4**2), rel=1e-3)

"""Skews of which only differences count: a fit says so, and which differences it knows."""

import numpy as np
from fit_problems import model_of

import tripod_doe as td
from tripod_doe.analyses.fit.estimation.identifiability import skews_alike
from tripod_doe.analyses.fit.estimation.misfit import Rows
from tripod_doe.analyses.fit.estimation.solution import solve
from tripod_doe.analyses.fit.estimation.unknowns import Unknown, make_layout

AHEAD = np.exp(2j * np.radians(120) * np.arange(3))
EACH = np.array([2.0, 3.0, 5.0, 8.0])  # second order of a groove by a skew of 1 deg, at four operating points, N
SKEWS = np.array([0.4, -0.3, 0.1])


def test_equal_skews_are_invisible_and_their_differences_are_found():
    """Exact physics: second orders of equally skewed needles at three grooves, 120 deg apart, cancel in the sum."""
    count, random = EACH.size, np.random.default_rng(2)
    noise = 0.05 * (random.standard_normal(count) + 1j * random.standard_normal(count))
    layout = make_layout([Unknown(f"skew_{at}", -1.0, 1.0) for at in (1, 2, 3)], ["r"] * count, [[""] * count] * 3)
    rows = Rows(
        record=np.arange(count),
        order=np.full(count, 2),
        measured=EACH * (AHEAD @ SKEWS) + noise,
        along=np.full(count, 0.05),
        across=np.full(count, 0.05),
        own_error=np.zeros((2, count)),
        shared=np.zeros((count, 0), complex),
        turning=np.zeros((count, 0)),
        free_phase=np.zeros(count, bool),
        free_sign=np.zeros(count, bool),
    )
    solution = solve(layout, rows, model_of(layout, lambda skews: (skews @ AHEAD)[:, None] * EACH))
    assert solution.verdicts == ("combination",) * 3
    assert all(own.high - own.low > 1.2 / 2 for own in solution.profiles)  # up to the bounds of another skew
    assert len(solution.combinations) == 2
    for known in solution.combinations:
        factors = np.zeros(3)
        factors[[scalar for scalar, _ in known.parts]] = [factor for _, factor in known.parts]
        assert abs(factors.sum()) < 0.02 * np.abs(factors).max()
        assert abs(known.value - factors @ SKEWS) < known.half < 0.1


def test_skews_in_other_places_of_the_circle_give_nearly_the_same_records():
    """Physics of `kinetostatic`: the second order beside the third is alike within its error, so a fit states both."""
    fitted, known = [0.4, -0.3, 0.0], [False, False, True]
    alike = skews_alike(fitted, known)
    assert np.allclose(alike, [[-0.7, -0.4, 0.0], [0.3, 0.7, 0.0]])

    def second(skews):
        own = {f"initial_skew_{at}_deg": one for at, one in enumerate(skews, start=1)}
        answer = td.simulate(model="kinetostatic", joint_angle_deg=8, torque_n_m=150, **own)
        amplitude, phase = (answer[f"thrust_{name}"].values.ravel() for name in ("amplitude", "phase_deg"))
        return amplitude[2] * np.exp(3j * np.radians(phase[2] - 2 / 3 * phase[3]))  # whichever trunnion is the first

    true = second(fitted)
    off = [abs(second(skews) - true) / abs(true) for skews in (*alike, [0.4, 0.3, 0.0], [-0.3, 0.4, 0.0])]
    assert max(off[:2]) < 0.35 < 1.0 < min(off[2:])


def test_opposite_skews_are_alike_where_the_sign_of_the_force_is_not_known():
    """Exact: a reversed force whose third order is turned back has the second order of opposite skews."""
    alike = [SKEWS.tolist(), *skews_alike(SKEWS.tolist(), [False] * 3, either_sign=True)]
    assert len(alike) == 6

    def seen(skews, sign):
        """The second order, whichever trunnion is the first, beside a third order of 1."""
        return (sign * (AHEAD @ np.array(skews)) * np.exp(-2j * np.angle(sign) / 3)) ** 3

    true = seen(alike[0], 1 + 0j)
    assert np.allclose([seen(each, 1 + 0j) for each in alike[1:3]], true)
    assert np.allclose([seen(each, -1 + 0j) for each in alike[3:]], true)

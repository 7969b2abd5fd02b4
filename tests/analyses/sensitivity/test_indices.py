"""Sensitivity indices against published functions, against SALib, and over resampled truths."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import xarray as xr
from published import ANGLE, CASES, ISHIGAMI, cube_of, ishigami, linear_interaction
from SALib.analyze import delta, dgsm, fast, morris, pawn, rbd_fast, sobol
from scipy.stats import norm

from slow_cases import first_fast
from tripod_doe.analyses import bootstrap, output_table
from tripod_doe.analyses.factorial_effects.factorial_effects import factorial_effects
from tripod_doe.analyses.sensitivity.delta import borgonovo_delta
from tripod_doe.analyses.sensitivity.dgsm import derivative_measures
from tripod_doe.analyses.sensitivity.fast import fast_indices
from tripod_doe.analyses.sensitivity.morris import MorrisSettings, morris_effects
from tripod_doe.analyses.sensitivity.pawn import ChanceSettings, PawnSettings, pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import rbd_fast_indices
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.analyses.settings import PointSettings, SensitivitySettings
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study import memory
from tripod_doe.study.cube import slab_reading

PROBLEM = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[0, 1]] * 3}


def two(x):
    return np.stack([ishigami(x), linear_interaction(x)], axis=1)


def unit_of(cube):
    return np.stack(
        [cube[name].values for name in cube.coords if cube[name].dims == ("point",) and name != "point"], axis=1
    )


@pytest.mark.parametrize("case", CASES)
def test_analytic_indices_lie_within_the_intervals(case):
    """Exact: published indices; one fixed seed, all six within 95 % intervals."""
    function, bounds, truth = CASES[case]
    found = sobol_indices(cube_of('kind = "saltelli"\nsamples = 512\nseed = 4', function, bounds))
    for key, exact in truth.items():
        if key in found:
            assert (np.abs(found[key] - exact) <= found[f"{key}_conf"] + 1e-12).all(), key


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Statistic: of 180 intervals of 95 %, between 90 and 99 % hold the analytic index."""
    hits = []
    for seed in range(30):
        cube = cube_of(f'kind = "saltelli"\nsamples = 64\nsecond_order = false\nseed = {seed}', ishigami, ANGLE)
        found = sobol_indices(cube, SensitivitySettings(precision=1))
        hits += [np.abs(found[key] - ISHIGAMI[key]) <= found[f"{key}_conf"] for key in ("S1", "ST")]
    assert 0.9 <= np.mean(hits) <= 0.99


def test_all_outputs_at_once_are_those_of_salib_one_by_one():
    """Exact to rounding: indices and, where SALib's draws can be repeated, intervals."""
    cube = cube_of('kind = "saltelli"\nsamples = 256\nseed = 1', two)
    ours = sobol_indices(cube, SensitivitySettings(seed=4))
    for k in range(2):
        theirs = sobol.analyze(PROBLEM, cube["y"].values[:, k], seed=5)
        for key in ("S1", "S1_conf", "ST", "ST_conf", "S2", "S2_conf"):
            assert ours[key].isel(k=k).values == pytest.approx(theirs[key], abs=1e-12, nan_ok=True)
    cube = cube_of('kind = "morris"\nsamples = 30\nseed = 1', two)
    ours = morris_effects(cube, MorrisSettings(seed=4))
    for k in range(2):
        theirs = morris.analyze(PROBLEM, unit_of(cube), cube["y"].values[:, k], seed=4)
        for key in ("mu", "mu_star", "sigma"):  # SALib's intervals of mu_star are too short
            assert ours[key].isel(k=k).values == pytest.approx(np.asarray(theirs[key], float), abs=1e-9)
    cube = cube_of('kind = "finite-differences"\nsamples = 64', two)
    ours = derivative_measures(cube)
    for k in range(2):
        theirs = dgsm.analyze(PROBLEM, unit_of(cube), cube["y"].values[:, k], seed=4)
        for key in ("vi", "dgsm"):
            assert ours[key].isel(k=k).values == pytest.approx(theirs[key], rel=1e-9)


def test_curves_and_samples_give_what_salib_gives():
    """Exact to rounding."""
    cube = cube_of('kind = "fast"\nsamples = 129\nseed = 1', two)
    ours = fast_indices(cube)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of SALib, on its intervals
        for k in range(2):
            theirs = fast.analyze(PROBLEM, cube["y"].values[:, k], num_resamples=10, seed=4)
            for key in ("S1", "ST"):
                assert ours[key].isel(k=k).values == pytest.approx(np.array(theirs[key]), abs=1e-12)
    assert "ST_conf" not in ours  # SALib's intervals hold the index in none of 100 cases where they are narrow
    assert "resolved" not in ours
    for samples in (120, 121):
        cube = cube_of(f'kind = "rbd-fast"\nsamples = {samples}\nseed = 1', two)
        x = unit_of(cube)
        first, slices = rbd_fast_indices(cube), pawn_indices(cube, PawnSettings())
        areas = borgonovo_delta(cube)
        number = int(np.round(min(int(np.ceil(samples ** (2 / (7 + np.tanh((1500 - samples) / 500))))), 48)))
        for k in range(2):
            y = cube["y"].values[:, k]
            theirs = rbd_fast.analyze(PROBLEM, x, y, num_resamples=10, seed=4)
            assert first["S1"].isel(k=k).values == pytest.approx(np.array(theirs["S1"], float), abs=1e-12)
            theirs = pawn.analyze(PROBLEM, x, y)
            for key in ("median", "mean", "maximum", "minimum"):
                assert slices[key].isel(k=k).values == pytest.approx(theirs[key], abs=1e-12)
            at, edges = np.linspace(y.min(), y.max(), 100), np.linspace(0, samples, number + 1)
            theirs = [delta.calc_delta(y, at, x[:, i], edges) for i in range(3)]
            assert areas["delta"].isel(k=k).values == pytest.approx(np.array(theirs), abs=1e-12)


@pytest.mark.parametrize(
    ("analyse", "settings"), first_fast([(pawn_indices, PawnSettings), (borgonovo_delta, ChanceSettings)], 1)
)
def test_an_index_without_honest_intervals_has_none_and_is_tested_against_chance(analyse, settings):
    """Of factors without effect one in twenty counts as resolved: at most 10 of 60 with a probability of 99.9 %."""
    resolved = 0
    for seed in range(30):
        cube = cube_of(
            f'kind = "latin-hypercube"\nsamples = 64\nseed = {seed}', lambda u: np.sin(6 * u[:, :1]) + 0 * u[:, :1]
        )
        answer = analyse(cube, settings(seed=seed))
        assert not [key for key in answer if "_conf" in key or "needed" in key]
        flags = answer["resolved"].values.ravel()
        assert flags[0] == 1
        resolved += int(flags[1:].sum())
    assert 1 <= resolved <= 10


def test_a_factor_with_levels_and_without_effect_is_not_resolved():
    """Regression: all points of a level had the same neighbours; 67 % of the intervals of 95 % held the true zero."""
    held = []
    for seed in range(15):
        cube = cube_of(f'kind = "latin-hypercube"\nsamples = 300\nseed = {seed}', lambda u: u[:, 0] + u[:, 1])
        two_levels = np.where(cube["speed_rpm"].values < 0.05, 0.0, 0.1)
        found = shapley_effects(cube.assign_coords(speed_rpm=("point", two_levels))).sel(factor="speed_rpm")
        held.append(abs(float(found["shapley"])) <= float(found["shapley_conf"]))
    assert sum(held) >= 14


def test_shapley_effects_of_correlated_factors():
    """Exact (Owen and Prieur 2017): of y = x1 with normal x1, x2 of correlation r, x2 has r^2 / 2 without acting."""
    r = 2 * np.sin(np.pi * 0.7 / 6)
    pairs = 'correlation = [["joint_angle_deg", "torque_n_m", 0.7]]'

    def outputs(u):
        x = norm.ppf(u)
        return np.stack([x[:, 0] + 0 * x[:, 1], x.sum(axis=1)], axis=1)

    found = shapley_effects(cube_of(f'kind = "latin-hypercube"\nsamples = 1024\nseed = 2\n{pairs}', outputs))
    exact = np.array([[1 - r**2 / 2, r**2 / 2, 0], np.array([1 + r, 1 + r, 1]) / (3 + 2 * r)]).T
    assert found["shapley"].sum("factor").values == pytest.approx([1, 1])
    assert (np.abs(found["shapley"] - exact) <= 1.5 * found["shapley_conf"] + 0.01).all()
    assert found["resolved"].sel(factor="speed_rpm").values.tolist() == [0, 1]
    correlated = cube_of(f'kind = "sobol"\nsamples = 64\n{pairs}', outputs)
    with pytest.raises(InputError, match="independent factors; factors of this study are correlated or"):
        rbd_fast_indices(correlated)
    constrained = cube_of('kind = "sobol"\nsamples = 64\nconstraints = ["torque_n_m < joint_angle_deg"]', outputs)
    with pytest.raises(InputError, match="factors of this study are correlated or constrained"):
        rbd_fast_indices(constrained)


def test_groups_have_one_index():
    """Exact: of 2 x1 + x2 + 3 x1 x2 and a third factor without effect, the group of the first two has all variance."""
    groups = {"joint_angle_deg": "both", "torque_n_m": "both"}
    found = sobol_indices(cube_of('kind = "saltelli"\nsamples = 256\nseed = 1', linear_interaction, groups=groups))
    assert found["factor"].values.tolist() == ["both", "speed_rpm"]
    assert found["ST"].values == pytest.approx([1, 0], abs=0.05)
    found = morris_effects(cube_of('kind = "morris"\nsamples = 16', linear_interaction, groups=groups))
    assert found["mu_star"].values[0] > 1
    assert np.isfinite(found["mu"].values).tolist() == [False, True]


def test_a_phase_has_the_indices_of_its_direction():
    """Exact: a phase that goes with x1 about +-180 deg has no jump, and one that only jumps by rounding no variance."""

    def phases(x):
        return np.stack([(160 + 40 * x[:, 0] + 10 * x[:, 1] + 180) % 360 - 180, np.full(len(x), 180.0)], axis=1)

    cube = cube_of('kind = "saltelli"\nsamples = 256\nseed = 1', phases)
    cube["y"].attrs["wraps_at"] = "+-180 degree"
    found = sobol_indices(cube)
    assert found["ST"].isel(k=0).values == pytest.approx([16 / 17, 1 / 17, 0], abs=0.05)
    assert found["ST"].isel(k=1).isnull().all()
    cube = cube_of('kind = "morris"\nsamples = 16', phases)
    cube["y"].attrs["wraps_at"] = "+-180 degree"
    assert morris_effects(cube)["mu"].isel(k=0).values == pytest.approx([40, 10, 0])


def test_a_waveform_beside_other_outputs_has_indices_at_each_angle():
    def wave(x):
        return x[:, :1] * np.sin(np.arange(8)) + x[:, 1:2] * np.cos(np.arange(8))

    cube = cube_of('kind = "saltelli"\nsamples = 64', wave).rename(y="thrust", k="rotation_deg")
    cube["other"] = cube["thrust"].max("rotation_deg")
    found = sobol_indices(cube)
    assert found["thrust_ST"].dims == ("factor", "rotation_deg")
    assert found["ST"].dims == ("factor",)
    assert found["thrust_ST"].isel(rotation_deg=0).values == pytest.approx([0, 1, 0], abs=0.2)


def test_a_course_that_is_read_in_parts_has_the_same_indices(monkeypatch, tmp_path):
    """Components do not know of each other; from a file that is read when it is used, with failed points."""

    def wave(x):
        return x[:, :1] * np.sin(np.arange(8)) + x[:, 1:2] * np.cos(np.arange(8))

    cube = cube_of('kind = "saltelli"\nsamples = 64', wave).rename(y="thrust", k="rotation_deg")
    cube["thrust"][[17, 90]] = np.nan
    cube["outcome"][[17, 90]] = Outcome.DIVERGED
    cube["other"] = cube["thrust"].max("rotation_deg")
    expected = sobol_indices(cube)
    cube.to_netcdf(tmp_path / "cube.nc")
    monkeypatch.setattr(output_table, "_MOST_NUMBERS", 1500)
    monkeypatch.setattr(slab_reading, "_SLAB_BYTES", 4000)
    with xr.open_dataset(tmp_path / "cube.nc", cache=False) as stored:
        assert len(list(output_table._parts(stored, "thrust", 512))) == 4
        found = sobol_indices(stored)
    xr.testing.assert_allclose(found, expected, rtol=1e-12)
    assert found.attrs == expected.attrs


def test_effects_of_a_course_over_a_grid_are_those_of_its_parts(monkeypatch, tmp_path):
    """From a file of which no output is ever read whole."""
    x, y = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 5), indexing="ij")
    course = x[..., None] * np.sin(np.arange(8)) + y[..., None] * np.arange(1, 9)
    factors = "joint_angle_deg = {low = 0, high = 1, count = 6}\ntorque_n_m = {low = 0, high = 1, count = 5}"
    cube = xr.Dataset(
        {
            "thrust": (("joint_angle_deg", "torque_n_m", "rotation_deg"), course),
            "outcome": (("joint_angle_deg", "torque_n_m"), np.full((6, 5), Outcome.FINISHED, np.int8)),
        },
        coords={"joint_angle_deg": np.linspace(0, 1, 6), "torque_n_m": np.linspace(0, 1, 5)},
        attrs={"study": f'[study]\nname = "t"\n[factors]\n{factors}\n'},
    )
    expected = factorial_effects(cube)
    assert expected["effect"].sel(term="torque_n_m").values == pytest.approx(np.arange(1, 9))
    cube.to_netcdf(tmp_path / "cube.nc")
    monkeypatch.setattr(output_table, "_MOST_NUMBERS", 100)
    with xr.open_dataset(tmp_path / "cube.nc", cache=False) as stored:
        found = factorial_effects(stored)
        assert not stored["thrust"].variable._in_memory
    xr.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_an_analysis_that_needs_too_much_memory_says_so_before_it_reads(monkeypatch):
    """Blocks of 5 points, 100 resamples of 64 blocks: 102 kB."""
    cube = cube_of('kind = "saltelli"\nsamples = 64\nsecond_order = false', lambda x: x[:, 0] + x[:, 1])
    for free, told in (
        (2000, "y of 320 points needs about 5.12 kB of memory, 2 kB are free"),
        (50_000, "a bootstrap of 64 blocks or points needs about 102 kB of memory, 50 kB are free"),
    ):
        monkeypatch.setattr(memory, "_free_memory", lambda free=free: free)
        with pytest.raises(InputError, match=told):
            sobol_indices(cube)


def test_a_bootstrap_that_is_drawn_in_parts_has_the_same_draws(monkeypatch):
    """Exact: SALib's draws."""
    drawn = np.random.default_rng(3).integers(50, size=(50, 12))
    whole = np.stack([np.bincount(column, minlength=50) for column in drawn.T]) / 50
    monkeypatch.setattr(bootstrap, "_DRAWN", 7)
    assert np.array_equal(bootstrap.bootstrap_weights(50, 12, 3), whole)


def test_convergence_says_how_many_more():
    """Exact: half the interval takes four times as many; a precision that is met is enough."""
    cube = cube_of('kind = "saltelli"\nsamples = 256\nseed = 2', ishigami, ANGLE)
    loose = sobol_indices(cube, SensitivitySettings(precision=1))
    assert loose["samples"].values.tolist() == [32, 64, 128, 256]
    assert loose["ST_over_samples"].values[-1] == pytest.approx(loose["ST"].values)
    assert float(loose["samples_needed"]) <= 256
    tight, tighter = (sobol_indices(cube, SensitivitySettings(precision=p))["samples_needed"] for p in (0.02, 0.01))
    assert float(tighter) == 4 * float(tight) > 256


def test_no_factor_is_ranked_below_the_numerical_error():
    """Regression: an effect of 0.01 where the runs report an error of 0.1 is flagged, and no sentence names it."""
    cube = cube_of('kind = "morris"\nsamples = 16', lambda x: 3 * x[:, 0] + 0.01 * x[:, 1])
    cube["y_error"] = ("point", np.full(cube.sizes["point"], 0.1), {"role": "record of the run"})
    found = morris_effects(cube)
    assert found["resolved"].values.tolist() == [1, 2, 2]


def planted(cube, rows):
    broken = cube.copy(deep=True)
    broken["y"][rows] = np.nan
    broken["outcome"][rows] = Outcome.DIVERGED
    return broken


def test_scattered_failures_drop_their_blocks():
    """Exact: ten failures cost ten blocks; the indices stay within the intervals of the whole, and no region is told."""
    cube = cube_of('kind = "saltelli"\nsamples = 256\nseed = 3', ishigami, ANGLE)
    whole = sobol_indices(cube)
    rows = np.random.default_rng(1).choice(256, 10, replace=False) * 8 + np.arange(10) % 8
    found = sobol_indices(planted(cube, rows))
    assert (found.attrs["points_dropped"], found.attrs["points_used"]) == (80, 8 * 246)
    assert "failing_region" not in found.attrs
    for key in ("S1", "ST"):
        assert (np.abs(found[key] - whole[key]) <= whole[f"{key}_conf"]).all()
    with pytest.raises(InputError, match='10 of 256 blocks of 8 points are missing, and holes = "refuse"'):
        sobol_indices(planted(cube, rows), SensitivitySettings(holes="refuse"))
    trajectories = cube_of('kind = "morris"\nsamples = 40', linear_interaction)
    found = morris_effects(planted(trajectories, [5, 6, 80]))
    assert (found.attrs["points_dropped"], found.attrs["points_used"]) == (8, 152)


def test_failures_in_one_corner_are_told_as_a_region():
    """Exact: the corner where two factors are large; the rest is a box in which the factors stay independent."""
    cube = cube_of('kind = "saltelli"\nsamples = 512\nseed = 3', ishigami, ANGLE)
    x = unit_of(cube)
    corner = np.flatnonzero((x[:, 0] > 0.93) & (x[:, 2] > 0.93))
    assert corner.size >= 10
    broken, whole = planted(cube, corner), sobol_indices(cube)
    found = sobol_indices(broken)
    assert found.attrs["points_dropped"] % 8 == 0
    region = found.attrs["failing_region"]
    assert "joint_angle_deg > 0.9" in region
    assert "speed_rpm > 0.9" in region
    assert f"({corner.size} of the " in region
    for answer in (found, sobol_indices(broken, SensitivitySettings(holes="rest", most_dropped=0))):
        for key in ("S1", "ST"):
            assert (np.abs(answer[key] - whole[key]) <= whole[f"{key}_conf"]).all()
    assert answer.attrs["answered_for"] == "the rest"
    with pytest.raises(InputError, match=r"most_dropped = 0; most failed where .* set holes = \"rest\""):
        sobol_indices(broken, SensitivitySettings(most_dropped=0))


def test_a_curve_with_a_failed_point_has_no_index():
    cube = cube_of('kind = "fast"\nsamples = 129\nseed = 1', linear_interaction)
    found = fast_indices(planted(cube, [130]), PointSettings(most_dropped=0.5))
    assert np.isfinite(found["S1"].values).tolist() == [True, False, True]
    assert found["S1"].values[[0, 2]] == pytest.approx(fast_indices(cube)["S1"].values[[0, 2]])
    assert found.attrs["points_dropped"] == 129


def polynomial(x):
    return 5 + 3 * x[:, 0] - 2 * x[:, 1] + 4 * x[:, 0] * x[:, 2] + x[:, 1] ** 2


@pytest.mark.parametrize(
    "design",
    [
        'kind = "full-factorial"\nlevels = 3',
        'kind = "central-composite"\nstar = "faced"',
        'kind = "central-composite"\nstar = "inscribed"',
        'kind = "box-behnken"',
    ],
)
def test_effects_of_a_polynomial_are_exact(design):
    """Exact: on coded levels -1 .. 1 a factor's effect is twice its coefficient, a square's its coefficient."""
    found = factorial_effects(cube_of(design, polynomial, {"low": -1.0, "high": 1.0}))
    exact = {"joint_angle_deg": 6, "torque_n_m": -4, "joint_angle_deg:speed_rpm": 8, "torque_n_m^2": 1}
    for term in found["term"].values:
        assert float(found["effect"].sel(term=term)) == pytest.approx(exact.get(term, 0), abs=1e-9), term
        assert float(found["effect_conf"].sel(term=term)) == pytest.approx(0, abs=1e-9)
    assert found["p_value"].sel(term=list(exact)).max() < 1e-9
    assert float(found["mean"]) == pytest.approx(5)
    assert float(found["r_squared"]) == pytest.approx(1)


def test_effects_name_their_aliases():
    """Exact: of resolution IV, each product of two factors stands for another one."""
    found = factorial_effects(
        cube_of('kind = "fractional-factorial"', lambda x: x[:, 0] + x[:, 2] * x[:, 3], {"low": -1.0, "high": 1.0}, 4)
    )
    assert '"speed_rpm:groove_sliding_friction": ["joint_angle_deg:torque_n_m"]' in found.attrs["aliases"]
    assert float(found["effect"].sel(term="joint_angle_deg:torque_n_m")) == pytest.approx(2)
    assert found.attrs["degrees_of_freedom"] == 0


def test_the_table_of_variances_adds_up():
    """Exact: on an orthogonal design the sums of squares of the terms and the residual are that of the output."""
    noise = np.random.default_rng(0).normal(size=64)
    cube = cube_of(
        'kind = "full-factorial"\nlevels = 2', lambda x: polynomial(x) + noise[: len(x)], {"low": -1.0, "high": 1.0}, 6
    )
    found = factorial_effects(cube)
    whole = float(((cube["y"] - cube["y"].mean()) ** 2).sum())
    assert float(found["sum_of_squares"].sum() + found["residual_sum_of_squares"]) == pytest.approx(whole)
    assert float(found["p_value"].sel(term="joint_angle_deg")) < 1e-6
    assert float(found["p_value"].sel(term="groove_rolling_friction")) > 1e-3


def test_rbd_fast_answers_whatever_the_number_of_points():
    """Regression: with 80 and 81 points, halves of which have 40, a division by zero ended the command."""
    for samples in (60, 79, 80, 81, 82):
        cube = cube_of(f'kind = "rbd-fast"\nsamples = {samples}\nseed = 1', ishigami)
        assert np.isfinite(rbd_fast_indices(cube)["S1_conf"]).all()

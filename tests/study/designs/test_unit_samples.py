"""Samples of which any rows are made alone: exactly the points of SciPy and SALib."""

from __future__ import annotations

import tracemalloc
import warnings

import numpy as np
import pytest
from SALib.sample import fast_sampler, finite_diff, sobol
from scipy.stats import qmc

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study import parse_study
from tripod_doe.study.definition.study_file import DesignTable, FactorTable
from tripod_doe.study.designs import make_points, salib_problem, unit_sample
from tripod_doe.study.designs.distributions import quantile
from tripod_doe.study.designs.unit_samples import RandomSample, SobolSample

TABLES = {name: FactorTable(low=0.0, high=1.0) for name in ("a", "b", "c")}
GROUPED = TABLES | {name: FactorTable(low=0.0, high=1.0, group="both") for name in ("a", "c")}
SOME = np.array([0, 7, 8, 9, 8191, 8192, 8200, 19_999, 3, 2, 12_345])


def design(kind, samples, **settings):
    return DesignTable(kind=kind, samples=samples, seed=11, **settings)


@pytest.mark.parametrize("scramble", [True, False])
@pytest.mark.parametrize("engine", [qmc.Sobol, qmc.Halton], ids=["sobol", "halton"])
def test_any_points_of_a_sequence_are_those_of_scipy(engine, scramble):
    """Exact: results of earlier versions are found by the values of their points."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a number of points that is no power of two
        whole = engine(3, scramble=scramble, rng=11).random(20_000)
    sample = unit_sample(design(engine.__name__.lower(), 20_000, scramble=scramble), TABLES)
    assert sample.count == 20_000
    assert np.array_equal(sample.at(SOME), whole[SOME])
    assert np.array_equal(sample.at(np.arange(8000, 17_000)), whole[8000:17_000])


def test_a_sobol_sequence_is_that_of_scipy_far_behind_its_beginning():
    """Exact: the point of a number with most of its bits set."""
    number = 2**24 - 2**13 - 3
    engine = qmc.Sobol(2, rng=3)
    far = SobolSample(qmc.Sobol(2, rng=3), number + 1).at(np.array([number]))
    assert np.array_equal(far, engine.fast_forward(number).random(1))


def test_more_points_than_a_sobol_sequence_has_are_refused():
    with pytest.raises(InputError, match="has 1,073,741,824 points, not 1,073,741,825"):
        SobolSample(qmc.Sobol(2, rng=3), 2**30 + 1)


@pytest.mark.parametrize("tables", [TABLES, GROUPED], ids=["alone", "grouped"])
@pytest.mark.parametrize("second_order", [True, False])
@pytest.mark.parametrize("scramblings", [1, 4])
def test_any_points_of_a_saltelli_design_are_those_of_salib(tables, second_order, scramblings):
    """Exact: as `SALib.sample.sobol` gives them, the blocks of several scramblings by turns."""
    samples = 64
    seeds = [11] if scramblings == 1 else np.random.default_rng(11).integers(2**31, size=scramblings).tolist()
    whole = [
        sobol.sample(salib_problem(tables), samples // scramblings, calc_second_order=second_order, seed=seed)
        for seed in seeds
    ]
    by_turns = np.stack([one.reshape(samples // scramblings, -1, 3) for one in whole], axis=1).reshape(-1, 3)
    sample = unit_sample(design("saltelli", samples, second_order=second_order, scramblings=scramblings), tables)
    assert sample.count == len(by_turns)
    assert np.array_equal(sample.at(np.arange(sample.count)), by_turns)
    rows = np.array([5, 4, 130, sample.count - 1, 0])
    assert np.array_equal(sample.at(rows), by_turns[rows])


@pytest.mark.parametrize("width", [1, 2, 5])
@pytest.mark.parametrize("samples", [65, 200])
def test_any_points_of_a_fast_design_are_those_of_salib(width, samples):
    """Exact, with fewer and with more frequencies than there are factors."""
    tables = {f"x{at}": FactorTable(low=0.0, high=1.0) for at in range(width)}
    whole = fast_sampler.sample(salib_problem(tables), samples, M=4, seed=11)
    sample = unit_sample(design("fast", samples), tables)
    assert sample.count == len(whole)
    assert np.array_equal(sample.at(np.arange(sample.count)), whole)
    rows = np.array([sample.count - 1, 3, 64, 0])
    assert np.array_equal(sample.at(rows), whole[rows])


def test_any_points_of_finite_differences_are_those_of_salib():
    """Exact."""
    whole = finite_diff.sample(salib_problem(TABLES), 50)
    sample = unit_sample(design("finite-differences", 50), TABLES)
    assert sample.count == len(whole) == 200
    assert np.array_equal(sample.at(np.arange(200)), whole)
    rows = np.array([199, 3, 4, 0])
    assert np.array_equal(sample.at(rows), whole[rows])


def test_any_random_points_are_those_of_the_whole_stream():
    """Exact."""
    whole = np.random.default_rng(11).random((20_000, 3))
    assert np.array_equal(RandomSample(20_000, 3, 11).at(SOME), whole[SOME])


def test_a_fleet_needs_no_memory_for_its_samples():
    """A million samples of six factors would be 48 MB, and twice that while they were made."""
    text = DISTRIBUTIONS.replace('{distribution = "normal", mean = 0.03, std = 0.001}', "{low = 0.01, high = 0.05}")
    study = parse_study(
        text.replace(
            '{distribution = "discrete", values = ["rollers", "equilibrium"], weights = [1, 3]}',
            '{values = ["equilibrium", "rollers"]}',
        )
        + '[design]\nkind = "multifidelity"\nindices = false\nsamples = 20\n'
        "split = {rollers = 20, equilibrium = 1_000_000}"
    )
    make_points(study)  # what is imported stays
    tracemalloc.start()
    points = make_points(study)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert points.count == 1_000_020
    assert peak < 4_000_000  # whether each is allowed, and a copy


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


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("sobol", "samples = 30"),
        ("halton", "samples = 30"),
        ("saltelli", "samples = 4"),
        ("sobol", 'samples = 300\nconstraints = ["torque_n_m > 40"]'),
        ("sobol", 'samples = 30\ncorrelation = [["torque_n_m", "speed_rpm", 0.5]]'),
        ("latin-hypercube", "samples = 30"),
        ("fast", "samples = 70"),
        ("multifidelity", "samples = 16\nsplit = {equilibrium = 16, rollers = 40}"),
        ("multifidelity", "samples = 16\nindices = false"),
    ],
)
def test_points_are_the_same_alone_and_together(kind, settings):
    text = DISTRIBUTIONS
    if kind == "multifidelity":
        text = text.replace('distribution = "discrete", ', "").replace(", weights = [1, 3]", "")
    points = make_points(parse_study(text + f'[design]\nkind = "{kind}"\n{settings}'))
    whole = points.columns
    rows = np.array([points.count - 1, 3, 17])
    alone, part = points.at(rows), points.part(5, 9).columns
    for name, column in whole.items():
        assert alone[name].tolist() == column[rows].tolist()
        assert part[name].tolist() == column[5:9].tolist()


def test_a_tail_that_a_parameter_does_not_allow_is_refused_before_any_point_is_made():
    text = DISTRIBUTIONS.replace("std = 0.001", "std = 0.01") + '[design]\nkind = "sobol"\nsamples = 100_000'
    with pytest.raises(InputError, match=r"needle_sliding_friction.*use a truncated-normal distribution"):
        make_points(parse_study(text))

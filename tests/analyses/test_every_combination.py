"""Every analysis with every design and every kind of factor: refused where it is planned, or true.

A new analysis, design or kind of factor must appear in the tables here.
"""

from __future__ import annotations

from collections import defaultdict
from functools import lru_cache

import numpy as np
import pytest
import xarray as xr
from combinations import FACTORS, FOLDER, RESPONSES, cube_of, text_of, truth_of

from slow_cases import first_fast
from tripod_doe.analyses.factorial_effects.factorial_effects import EffectsSettings, factorial_effects
from tripod_doe.analyses.main_effects.main_effects import factor_effects
from tripod_doe.analyses.multifidelity.quantiles import quantiles
from tripod_doe.analyses.registry import ANALYSES
from tripod_doe.analyses.sensitivity.delta import borgonovo_delta
from tripod_doe.analyses.sensitivity.dgsm import derivative_measures
from tripod_doe.analyses.sensitivity.fast import fast_indices
from tripod_doe.analyses.sensitivity.morris import MorrisSettings, morris_effects
from tripod_doe.analyses.sensitivity.pawn import ChanceSettings, PawnSettings, pawn_indices
from tripod_doe.analyses.sensitivity.rbd_fast import rbd_fast_indices
from tripod_doe.analyses.sensitivity.sentences import find_in_sensitivity
from tripod_doe.analyses.sensitivity.shapley import shapley_effects
from tripod_doe.analyses.sensitivity.sobol import sobol_indices
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.tolerance.tolerance import ToleranceSettings, tolerance
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import FAMILIES, make_points
from tripod_doe.workflow.analyses import check_analyses

DESIGNS = {
    "grid": "",
    "table": 'table = "combinations.csv"',
    "zip": "",
    "one-at-a-time": "",
    "sobol": "samples = 64",
    "halton": "samples = 64",
    "latin-hypercube": "samples = 64",
    "rbd-fast": "samples = 64",
    "saltelli": "samples = 16",
    "morris": "samples = 10",
    "finite-differences": "samples = 16",
    "fast": "samples = 65",
    "multifidelity": "samples = 16",
    "full-factorial": "",
    "fractional-factorial": "",
    "plackett-burman": "",
    "central-composite": "",
    "box-behnken": "",
    "ablation": 'factors = ["a", "b", "c"]',
    "product": 'of = ["one", "other"]\n[design.one]\nkind = "latin-hypercube"\nsamples = 8\nfactors = ["a", "b"]\n'
    '[design.other]\nkind = "latin-hypercube"\nsamples = 4\nfactors = ["c"]',
}
"""A small design of each kind, over three factors a, b and c."""

MORE = {
    "one-at-a-time": "[base]\na = 0\nb = 0\nc = 0\n",
    "multifidelity": '[factors.model]\nvalues = ["cheap", "truth"]\n',
}
KEYS = {
    "correlated": 'correlation = [["a", "b", 0.5]]',
    "constrained": 'constraints = ["a + b < 1.4"]',
    "unscrambled": "scramble = false",
}
"""Keys of a design that change what its points are."""

ACCEPTED = """
the kinds and keys in the order of FACTORS and KEYS
grid                  .........++..+.
table                 .........+...+.
zip                   .........++..+.
one-at-a-time         .........++..+.
sobol                 +++++++++...+++
halton                +++++++++...+++
latin-hypercube       +++++++++...++.
rbd-fast              +++++++++....+.
saltelli              +++++++++..+...
morris                +.+++++++..+...
finite-differences    +.+++..........
fast                  +++++..........
multifidelity         +++++++++..+...
full-factorial        +........++..+.
fractional-factorial  +............+.
plackett-burman       +............+.
central-composite     +............+.
box-behnken           +............+.
ablation              .............+.
product               +++++++++....+.
"""
"""Which designs take which factors, and which keys with uniform factors (levels, where a design needs them)."""

ANALYSED = """
sobol: saltelli
morris: morris
fast: fast
rbd-fast: sobol halton latin-hypercube rbd-fast
pawn: sobol halton latin-hypercube rbd-fast
delta: sobol halton latin-hypercube rbd-fast
dgsm: finite-differences
shapley: latin-hypercube rbd-fast
effects: grid table zip sobol halton latin-hypercube rbd-fast full-factorial fractional-factorial plackett-burman central-composite box-behnken
tolerance: sobol halton latin-hypercube rbd-fast
multifidelity: multifidelity
surrogate: grid table sobol halton latin-hypercube rbd-fast full-factorial central-composite box-behnken
contribution: ablation
stability: grid product
"""
"""Which designs an analysis takes, where it is planned."""


def study_of(design, kind="", analysis="", keys=""):
    if not kind:
        listed = {"ablation": "two listed"} | dict.fromkeys(("grid", "zip", "one-at-a-time"), "listed")
        kind = listed.get(design, "none" if design == "table" else "uniform")
    more = MORE.get(design, "") + (f"[analysis.{analysis}]\n" if analysis else "")
    more += 'output = "y"\n' if analysis in ("stability", "contribution") else ""
    return parse_study(text_of(f'kind = "{design}"\n{keys}\n{DESIGNS[design]}', (kind,) * 3, more), folder=FOLDER)


def accepts(*words, **keys):
    try:
        study = study_of(*words, **keys)
        make_points(study)
        check_analyses(study)
    except InputError:
        return False
    return True


def marks(design):
    found = [accepts(design, kind) for kind in FACTORS] + [accepts(design, keys=keys) for keys in KEYS.values()]
    return "".join("+" if each else "." for each in found)


def test_each_design_takes_what_it_can_use():
    """A design or a kind of factor that is new must be judged here."""
    assert set(DESIGNS) == set(FAMILIES)
    assert {line.split()[0]: line.split()[1] for line in ACCEPTED.strip().split("\n")[1:]} == {
        design: marks(design) for design in DESIGNS
    }


def analysed(kind):
    return " ".join(design for design in DESIGNS if accepts(design, analysis=kind))


def test_each_analysis_takes_designs_that_it_can_read():
    kinds = [kind for kind, row in ANALYSES.items() if row.designs]
    assert set(CHECKS) | set(ELSEWHERE) == set(kinds)
    table = dict(line.split(": ") for line in ANALYSED.strip().split("\n"))
    assert table == {kind: analysed(kind) for kind in kinds}


@pytest.mark.parametrize("key", ["correlated", "constrained"])
def test_indices_of_independent_factors_are_refused_of_others(key):
    for kind, row in ANALYSES.items():
        if row.independent:
            assert not accepts("latin-hypercube", analysis=kind, keys=KEYS[key])


KINDS = (
    ("uniform", "uniform", "uniform"),
    ("two", "uniform", "two"),
    ("words", "five", "uniform"),
    ("log", "normal", "triangular"),
    ("weighted", "truncated", "words"),
)
"""Kinds of the factors a, b and c; the responses do not depend on c."""
BOUNDED = tuple(kinds for kinds in KINDS if "normal" not in kinds)
CONTINUOUS = (("uniform",) * 3, ("log", "truncated", "triangular"))


def hits_of(result, key, truth):
    """Whether the intervals hold the truth, by response and factor; nothing where none is stated."""
    values, halves = result[key].values, result[f"{key}_conf"].values
    hits = np.abs(values - truth) <= halves + 1e-6 * np.maximum(1, np.abs(truth))
    for row, part in enumerate(result[result[key].dims[0]].values):
        for at, name in enumerate(RESPONSES):
            if np.isfinite(values[row, at] + halves[row, at] + truth[row, at]):
                yield (key, name, str(part)), hits[row, at]


def of_indices(analyse, design, keys, settings=SensitivitySettings):
    """Intervals of indices whose truth is that of the grid."""

    def check(kinds, seed, lost):
        result = analyse(
            cube_of(text_of(f"{design}\nseed = {seed}", kinds), lost), settings(seed=seed, most_dropped=0.8)
        )
        for key in keys:
            yield from hits_of(result, key, truth_of(kinds)[key])

    return check


@lru_cache
def long_run(analyse, design, kinds, key):
    return analyse(cube_of(text_of(design, kinds)))[key].values


def of_effects(kinds, seed, lost):
    """Elementary effects beside those of many trajectories; of a sum they are exact, whatever the factors are."""
    result = morris_effects(
        cube_of(text_of(f'kind = "morris"\nsamples = 12\nseed = {seed}', kinds), lost), MorrisSettings(most_dropped=0.8)
    )
    yield ("exact", "sum", "a"), abs(float(result["mu_star"][0, 0]) - 3) < 3e-2 + 3 * ("log" in kinds)
    yield from hits_of(
        result, "mu_star", long_run(morris_effects, 'kind = "morris"\nsamples = 1500\nseed = 999', kinds, "mu_star")
    )


def of_derivatives(kinds, seed, lost):
    """Upper bounds of total indices, and none of responses with jumps."""
    result = derivative_measures(
        cube_of(text_of(f'kind = "finite-differences"\nsamples = {40 + seed}', kinds), lost),
        SensitivitySettings(most_dropped=0.8),
    )
    truth = truth_of(kinds)["ST"]
    for at, name in enumerate(RESPONSES):
        bound = (result["dgsm"] + result["dgsm_conf"]).values[:, at]
        for factor in range(3):
            if np.isfinite(bound[factor]):
                yield ("dgsm", name, "abc"[factor]), bound[factor] >= truth[factor, at] - 0.01


def of_curves(kinds, seed, lost):
    """Indices by search curves, without intervals, of smooth responses; a curve with a failed point has none."""
    result = fast_indices(cube_of(text_of(f'kind = "fast"\nsamples = 257\nseed = {seed}', kinds)))
    for key in ("S1", "ST"):
        for name in ("sum", "product", "offset"):
            near = np.abs(result[key].values - truth_of(kinds)[key])[:, RESPONSES.index(name)] < 0.05
            yield from (((key, name, part), bool(hit)) for part, hit in zip("abc", near, strict=True))


def of_chance(analyse, settings):
    """Indices of whole distributions lie between 0 and 1, and only one in twenty factors without effect is resolved."""

    def check(kinds, seed, lost):
        result = analyse(
            cube_of(text_of(f'kind = "latin-hypercube"\nsamples = 60\nseed = {seed}', kinds), lost),
            settings(seed=seed, most_dropped=0.8),
        )
        key = "median" if "median" in result else "delta"
        for at, name in enumerate(RESPONSES):
            if name != "constant" and np.isfinite(result[key][0, at]):
                yield ("not resolved", "without effect", "c"), int(result["resolved"][2, at]) == 0
                yield (
                    ("between 0 and 1", name, "all"),
                    bool((result[key][:, at] >= 0).all() and (result[key][:, at] <= 1).all()),
                )

    return check


def of_regression(design):
    """Effects beside those of a regression on many points, from one end of the points to the other."""

    def check(kinds, seed, lost):
        result = factorial_effects(
            cube_of(text_of(f"{design}\nseed = {seed}", kinds), lost), EffectsSettings(most_dropped=0.8)
        )
        many = long_run_effects(kinds)
        terms = [term for term in result["term"].values if term in many["term"]]
        yield from hits_of(result.sel(term=terms), "effect", many.sel(term=terms).values)

    return check


@lru_cache
def long_run_effects(kinds):
    return factorial_effects(cube_of(text_of('kind = "latin-hypercube"\nsamples = 20000\nseed = 999', kinds)))["effect"]


def of_distribution(design):
    """Quantiles, chances to exceed and gains of smaller scatters."""

    def check(kinds, seed, lost):
        flat, wanted, named = truth_of(kinds)["flat"], [0.1, 0.5, 0.9], ["heavy", "offset", "ties", "rare"]
        shift = np.where(np.array(RESPONSES) == "offset", 1e6, 0.0)
        limits = {
            name: float(np.quantile(flat[:, at], 0.85)) + shift[at]
            for at, name in enumerate(RESPONSES)
            if name in named
        }
        cube = cube_of(text_of(f"{design}\nseed = {seed}", kinds), lost, outputs="single")
        result = tolerance(
            cube, ToleranceSettings(outputs=named, limits=limits, probabilities=wanted, seed=seed, most_dropped=0.8)
        )
        for name in named:
            at = RESPONSES.index(name)
            own, rounding = result.sel(output=name), 1e-6
            for place, chance in enumerate(wanted):
                low, high = float(own["quantile_low"][place]), float(own["quantile_high"][place])
                exact = np.quantile(flat[:, at], chance, method="inverted_cdf") + shift[at]
                yield ("quantile", name, str(chance)), not (low > exact + rounding or high < exact - rounding)
            beyond = float((flat[:, at] + shift[at] > limits[name]).mean())
            yield (
                ("exceedance", name, ""),
                float(own["exceedance_low"]) - 1e-9 <= beyond <= float(own["exceedance_high"]) + 1e-9,
            )

    return check


CHECKS = {
    "sobol": (of_indices(sobol_indices, 'kind = "saltelli"\nsamples = 32\nsecond_order = false', ("S1", "ST")), KINDS),
    "morris": (of_effects, BOUNDED),
    "fast": (of_curves, CONTINUOUS[:1]),
    "rbd-fast": (of_indices(rbd_fast_indices, 'kind = "latin-hypercube"\nsamples = 70', ("S1",)), KINDS),
    "shapley": (of_indices(shapley_effects, 'kind = "latin-hypercube"\nsamples = 60', ("shapley",)), KINDS),
    "dgsm": (of_derivatives, CONTINUOUS),
    "pawn": (of_chance(pawn_indices, PawnSettings), KINDS),
    "delta": (of_chance(borgonovo_delta, ChanceSettings), KINDS),
    "effects": (of_regression('kind = "latin-hypercube"\nsamples = 30'), BOUNDED),
    "tolerance": (of_distribution('kind = "latin-hypercube"\nsamples = 40'), KINDS),
}

"""For each analysis what it states, and kinds of factors that its design takes."""

ELSEWHERE = {
    "multifidelity": "test_known_truths.py",
    "surrogate": "test_known_truths.py",
    "contribution": "test_known_truths.py",
    "stability": "stability",
}
"""Where analyses are checked that state nothing of a sample, or whose samples are no design of three factors."""


def shares(kind, seeds, lost):
    """How often each statement of an analysis is true, by kinds of factors and statement, with the number of cases."""
    check, every = CHECKS[kind]
    hits = defaultdict(list)
    for kinds in every:
        for seed in range(seeds):
            for (what, response, part), hit in check(kinds, seed, lost):
                hits["/".join(kinds), what, response, part].append(bool(hit))
    return {key: (np.mean(each), len(each)) for key, each in hits.items()}


@pytest.mark.parametrize("kind", first_fast(CHECKS, 5))
def test_what_is_stated_is_true(kind):
    """Statistic: of all statements of 95 %, those of few designs, of which every tenth point fails."""
    found = shares(kind, seeds=1, lost=0.1)
    assert np.average([each for each, _ in found.values()], weights=[count for _, count in found.values()]) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("kind", CHECKS)
def test_each_statement_is_true_as_often_as_it_says(kind):
    """Statistic: 95 % are stated; fewer than 80 % of 60 designs have a chance of one in 50,000.

    Of responses whose intervals are stated in a few of the designs alone, these are unusual.
    """
    found = shares(kind, seeds=60, lost=0.0)
    wrong = {key: share for key, (share, count) in found.items() if count >= 45 and share < 0.8}
    assert not wrong
    assert np.average([each for each, _ in found.values()], weights=[count for _, count in found.values()]) >= 0.95


def test_levels_that_are_the_whole_answer():
    """Exact: distances of distributions of three equal levels are 2/3, of which the last level has one, too."""
    text = text_of('kind = "latin-hypercube"\nsamples = 300', ("words", "uniform", "uniform"))
    cube = cube_of(text).isel(k=[RESPONSES.index("ties")])
    levels = xr.apply_ufunc(lambda word: np.select([word == "low", word == "mid"], [0.0, 1.0], 2.0), cube["a"])
    for response, whole in ((levels, 2 / 3), (levels == 2, 4 / 9)):
        one = cube.assign(y=response.astype(float).expand_dims("k", 1))
        assert borgonovo_delta(one)["delta"].values[0, 0] == pytest.approx(whole, abs=0.02)
        slices = pawn_indices(one)
        assert slices["maximum"].values[0, 0] == pytest.approx(2 / 3, abs=0.01)
        assert rbd_fast_indices(one)["S1"].values[0, 0] == pytest.approx(1, abs=0.01)


def test_a_normal_factor_has_no_lower_end():
    """Regression: the first point of a sequence that is not scrambled lay seven standard deviations off."""
    with pytest.raises(InputError, match="not scrambled"):
        make_points(study_of("sobol", "normal", keys="scramble = false"))


def test_a_block_of_differences_counts_once():
    """Statistic: 5 % of the effects of a factor without effect are significant where blocks repeat its values."""
    significant, trends = [], []
    for seed in range(40):
        random = np.random.default_rng(seed)
        base = random.random((40, 4))
        rows = np.repeat(base[:, None], 3, axis=1)
        rows[:, 1, 0] += 0.01
        rows[:, 2, 1] += 0.01
        columns = dict(zip("abcd", rows.reshape(-1, 4).T, strict=True))
        response = np.cos(14.6 * columns["a"]) * np.sin(10.5 * columns["b"])
        significant += list(effects_of(columns, response).sel(term=["c", "d"])["p_value"].values < 0.05)
        fits = [effect.fit for effect in factor_effects(columns, response) if effect.factor in "cd"]
        trends += [abs(fit.trend.value) > fit.trend.half for fit in fits]
    assert np.mean(significant) <= 0.1
    assert np.mean(trends) <= 0.1


@pytest.mark.slow
def test_rows_of_a_table_that_is_crossed_with_levels_count_once():
    """Statistic: as above, of a table that repeats the rows of a sample at eight levels, and of one that is doubled."""
    significant = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        sample = np.repeat(random.random((30, 3)), 8, axis=0).T
        columns = dict(zip("abc", sample, strict=True)) | {"s": np.tile(np.arange(8.0), 30)}
        response = np.cos(14.6 * columns["a"]) * np.sin(10.5 * columns["b"]) * (1 + 0.1 * columns["s"])
        once = effects_of(columns, response)
        twice = effects_of({name: np.tile(column, 2) for name, column in columns.items()}, np.tile(response, 2))
        assert once["p_value"].values == pytest.approx(twice["p_value"].values)
        significant += list(once.sel(term=["c", "c:s"])["p_value"].values < 0.05)
    assert np.mean(significant) <= 0.12


def effects_of(columns, response):
    """Effects by the points of a table."""
    factors = "".join(f"{name} = {{}}\n" for name in columns)
    outcome = np.full(response.size, Outcome.FINISHED, np.int8)
    return factorial_effects(
        xr.Dataset(
            {"y": ("point", response), "outcome": ("point", outcome)},
            coords={name: ("point", column) for name, column in columns.items()},
            attrs={"study": f'[study]\nname = "t"\n[factors]\n{factors}[design]\nkind = "table"\ntable = "x.csv"\n'},
        )
    )


def test_quantiles_of_tied_outputs_by_several_models():
    """Regression: the upper end was the place before a value that many points share, and held none of 20 medians."""
    held = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        x = random.random((400, 1))
        truth, cheap = np.floor(4 * x), 4.4 * x + 0.1 * np.sin(9 * x)
        _, low, high = quantiles([truth[:40], cheap], [0.1, 0.4, 0.9], 1.96)
        held += [not (a > t or b < t) for a, t, b in zip(low, (0, 1, 3), high, strict=True)]
    assert np.mean(held) >= 0.93


def test_derivatives_bound_nothing_that_jumps():
    """Regression: a step was given an upper bound of 0 with an interval of 0."""
    found = derivative_measures(cube_of(text_of('kind = "finite-differences"\nsamples = 32', ("uniform",) * 3)))
    assert np.isnan(found["dgsm"].values[:, RESPONSES.index("jumps")]).all()
    assert any("No bounds are stated" in each for each in find_in_sensitivity(found, "dgsm"))


def test_intervals_of_what_few_samples_decide_are_not_stated():
    """Regression: of a response that differs from zero in five of 64 blocks, intervals held in 38 to 70 %."""
    found = sobol_indices(cube_of(text_of('kind = "saltelli"\nsamples = 64', ("uniform",) * 3)))
    rare = found.isel(k=RESPONSES.index("rare"))
    assert np.isnan(rare["ST_conf"]).all()
    assert not (rare["resolved"] == 1).any()
    sentences = " ".join(find_in_sensitivity(found.isel(k=[RESPONSES.index("rare")]), "sobol"))
    assert "No intervals are known" in sentences
    assert "nan" not in sentences

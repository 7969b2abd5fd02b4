"""What a plan counts is what runs, for every kind of design; what is too large is refused before it is made."""

from __future__ import annotations

import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import FAMILIES, make_points, point_count
from tripod_doe.workflow.run_study import run

RANGES = (
    "torque_n_m = {low = 20, high = 50}\nspeed_rpm = {low = 400, high = 600}\njoint_angle_deg = {low = 4, high = 8}"
)
LEVELS = "torque_n_m = {low = 20, high = 50, count = COUNT}\nspeed_rpm = {values = [100, 900]}"
PAIRS = "torque_n_m = {low = 20, high = 50, count = COUNT}\nspeed_rpm = {low = 100, high = 900, count = COUNT}"
SWITCHES = "groove_sliding = {values = [1, 0]}\nneedle_sliding = {values = [1, 0]}"
SIZED = {
    "grid": (LEVELS, ""),
    "zip": (PAIRS, ""),
    "one-at-a-time": (LEVELS, ""),
    "latin-hypercube": (RANGES, "samples = COUNT"),
    "sobol": (RANGES, "samples = COUNT"),
    "halton": (RANGES, "samples = COUNT"),
    "saltelli": (RANGES, "samples = COUNT"),
    "morris": (RANGES, "samples = COUNT"),
    "fast": (RANGES, "samples = 65COUNT"),
    "rbd-fast": (RANGES, "samples = COUNT"),
    "finite-differences": (RANGES, "samples = COUNT"),
    "full-factorial": (RANGES, "levels = COUNT"),
    "multifidelity": (
        f'{RANGES}\nmodel = {{values = ["equilibrium", "kinetostatic"]}}',
        "samples = 16COUNT\nsplit = {equilibrium = 2COUNT, kinetostatic = 16COUNT}",
    ),
}
"""Factors and settings of the designs whose size is a number; COUNT stands for digits of it."""
FIXED = {
    "fractional-factorial": (RANGES, ""),
    "plackett-burman": (RANGES, ""),
    "central-composite": (RANGES, ""),
    "box-behnken": (RANGES, ""),
    "ablation": (SWITCHES, ""),
    "product": (
        LEVELS.replace("COUNT", "3"),
        'of = ["one", "two"]\n[design.one]\nkind = "grid"\nfactors = ["torque_n_m"]\n'
        '[design.two]\nkind = "grid"\nfactors = ["speed_rpm"]',
    ),
}
ELSEWHERE = {"table"}
"""Designs whose points stand in a file: only reading it tells how many they are."""


def study_of(kind, count):
    factors, more = (SIZED | FIXED)[kind]
    text = f'[study]\nname = "s"\n[factors]\n{factors}\n[design]\nkind = "{kind}"\n{more}\n[keep]\noutputs = ["thrust_rms"]'
    return parse_study(text.replace("COUNT", str(count)))


def test_every_kind_of_design_is_looked_at():
    assert FAMILIES.keys() == SIZED.keys() | FIXED.keys() | ELSEWHERE


@pytest.mark.parametrize("kind", first_fast(sorted(SIZED | FIXED), 5))
@settings(deadline=None, max_examples=8)
@given(count=st.integers(2, 9))
def test_a_plan_counts_the_points_that_are_made(kind, count):
    study = study_of(kind, 1 << count if kind == "saltelli" else count)
    planned = td.plan(study, timing=False)
    assert point_count(study) == planned.points == make_points(study).count
    assert planned.most_points == 0


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
@pytest.mark.parametrize("kind", sorted(SIZED | FIXED))
def test_what_is_planned_runs(kind, tmp_path):
    study = study_of(kind, 2)
    planned = td.plan(study, timing=False)
    assert run(study, tmp_path, workers=0, progress=False).computed == planned.unique


@pytest.mark.parametrize("kind", sorted(SIZED))
@pytest.mark.parametrize("count", [1 << 40, 1 << 60])
def test_what_is_too_large_is_refused_before_it_is_made(kind, count):
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"needs about|must be at most 1,000,000"):
            make_points(study_of(kind, count))
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("given", ["samples = 4\nlevels = 1_000_000_000", "samples = 4\nlevels = 1_000_001"])
def test_levels_of_trajectories_are_bounded_as_those_of_a_grid(given):
    """Regression: `levels = 1000000000` of a morris design took gigabytes and half a minute of a plan."""
    with pytest.raises(InputError, match=r"levels = .*: must be at most 1,000,000"):
        make_points(parse_study(f'[study]\nname = "s"\n[factors]\n{RANGES}\n[design]\nkind = "morris"\n{given}\n'))

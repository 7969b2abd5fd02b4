"""Studies that are too large are refused from counts alone, before any point is made."""

from __future__ import annotations

import time

import pytest

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points, point_count

RANGE = "{low = 1, high = 20, count = 1000}"
GRID = f"[factors]\njoint_angle_deg = {RANGE}\ntorque_n_m = {RANGE}\nspeed_rpm = {RANGE}"
FEW = "[factors]\njoint_angle_deg = {low = 1, high = 20, count = 3}\ntorque_n_m = {low = 1, high = 9, count = 3}\n"


def study(text):
    return parse_study('[study]\nname = "large"\n' + text)


@pytest.mark.parametrize(
    "text",
    [
        GRID,
        FEW + '[design]\nkind = "sobol"\nsamples = 1_000_000_000',
        FEW + '[design]\nkind = "latin-hypercube"\nsamples = 1_000_000_000',
        FEW + '[design]\nkind = "saltelli"\nsamples = 1_073_741_824',
    ],
)
def test_a_billion_points_are_refused_at_once(text):
    """Regression: planning took 17 GB and said nothing."""
    large = study(text)
    started = time.perf_counter()
    with pytest.raises(
        InputError, match=r"\d+,\d+,\d+,\d+ points needs about .* [GT]B of memory, .* GB are free: use fewer"
    ):
        make_points(large)
    assert time.perf_counter() - started < 0.1


@pytest.mark.parametrize(
    "design",
    [
        'kind = "grid"',
        'kind = "zip"',
        'kind = "one-at-a-time"',
        'kind = "sobol"\nsamples = 5',
        'kind = "saltelli"\nsamples = 4',
        'kind = "saltelli"\nsamples = 4\nsecond_order = false',
        'kind = "morris"\nsamples = 4',
        'kind = "halton"\nsamples = 5',
        'kind = "fast"\nsamples = 65',
        'kind = "rbd-fast"\nsamples = 20',
        'kind = "finite-differences"\nsamples = 5',
        'kind = "full-factorial"\nlevels = 3',
        'kind = "fractional-factorial"\nresolution = 3',
        'kind = "plackett-burman"',
        'kind = "central-composite"\nstar = "faced"',
        'kind = "central-composite"\nstar = "inscribed"',
        'kind = "product"\nof = ["a", "b"]\n[design.a]\nfactors = ["joint_angle_deg"]\n'
        '[design.b]\nfactors = ["torque_n_m"]\nkind = "zip"',
        'kind = "product"\nof = ["a", "b"]\n[design.a]\nkind = "ablation"\n'
        '[design.b]\nfactors = ["joint_angle_deg", "torque_n_m"]',
    ],
)
def test_points_are_counted_as_they_are_made(design):
    """Exact: the count from the levels is the length of the design."""
    levels = any(f'"{kind}"' in design for kind in ("grid", "zip", "one-at-a-time", "product"))
    counted = study(f"{FEW if levels else FEW.replace(', count = 3', '')}[design]\n{design}\n")
    assert point_count(counted) == make_points(counted).count


@pytest.mark.parametrize(("combinations", "count"), [("all", 32), ("single", 12)])
def test_ablations_are_counted(combinations, count):
    counted = study(f'[design]\nkind = "ablation"\ncombinations = "{combinations}"\n')
    assert point_count(counted) == make_points(counted).count == count


def test_a_million_levels_are_the_most():
    with pytest.raises(InputError, match="count = 1000000000"):
        study("[factors]\njoint_angle_deg = {low = 1, high = 20, count = 1_000_000_000}\n")

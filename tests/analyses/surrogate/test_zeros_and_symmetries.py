"""What is known of an output is exact in its surrogate: zeros on every slider, and the mirror of the skews."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.analyses.surrogate.surrogate import SurrogateSettings, surrogate
from tripod_doe.analyses.surrogate.what_if_page import what_if_pages
from tripod_doe.joint.outputs import JOINT_OUTPUTS
from tripod_doe.model_interface import MIRRORED_BY, ZERO_AT, Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

OUTPUT = JOINT_OUTPUTS["thrust_amplitude"]
SKEWS = OUTPUT.mirrored_by


def wave(columns, shape):
    """Orders 0 to 3 that vanish without torque and angle, jump with the sign of torque and mirror with the skews.

    `shape` are random numbers: an exponent of the angle, and how drive and coast, skew and angle enter.
    """
    torque, angle, skews = columns["torque_n_m"] / 100, columns["joint_angle_deg"] / 10, columns["initial_skew_1_deg"]
    skews = skews + 0.4 * columns["initial_skew_2_deg"]
    size = np.abs(torque) * angle ** shape[0] * (1 + shape[1] * (torque < 0)) * (1 + shape[2] * angle)
    third = 10 * size * np.exp(1j * (shape[3] + 0.8 * (torque < 0))) * (1 + 0.2 * skews**2)
    second = size * (skews + shape[4] * skews**3) * np.exp(1j * shape[3])
    return np.stack([0.1 * second.real, 0 * third, second, third], axis=1)


def learnt(random, samples, ends):
    """Cube and page of a random function, over ranges that end at zero or hold it."""
    text = (
        '[study]\nname = "t"\n[factors]\n'
        f"torque_n_m = {{low = {ends[0]}, high = 90}}\njoint_angle_deg = {{low = {ends[1]}, high = 14}}\n"
        "initial_skew_1_deg = {low = -0.7, high = 0.9}\ninitial_skew_2_deg = {low = -0.5, high = 0.5}\n"
        f'[design]\nkind = "latin-hypercube"\nsamples = {samples}\nseed = 1\n'
    )
    columns, shape = make_points(parse_study(text)).columns, random.uniform(0.3, 1.5, 5)
    values = wave(columns, shape)
    known = {ZERO_AT: " ".join(OUTPUT.zero_at), MIRRORED_BY: " ".join(SKEWS)}
    cube = xr.Dataset(
        {
            "thrust_amplitude": (("point", "order"), np.abs(values), {"units": "N", **known}),
            "thrust_phase_deg": (("point", "order"), np.degrees(np.angle(values)), {"wraps_at": "+-180 degree"}),
            "outcome": ("point", np.full(samples, Outcome.FINISHED, np.int8)),
        },
        coords={"order": np.arange(4)} | {name: ("point", column) for name, column in columns.items()},
        attrs={"study": text, "fixed_parameters": '{"initial_skew_3_deg": 0.0}'},
    )
    result = surrogate(cube, SurrogateSettings())
    return cube, shape, what_if_pages({"surrogate": result})[0]


def third_of(page):
    """Place of the third order among the quantities of a page, which begins with the largest."""
    return next(at for at, each in enumerate(page.quantities) if "third" in each.label)


@pytest.mark.parametrize("seed", first_fast(range(4), 1))
def test_zeros_and_mirrors_are_exact_for_any_function(seed):
    """Exact: regression of "22.17 +- 18 N" at 0 N m, where the thrust is 0."""
    random = np.random.default_rng(seed)
    _, shape, page = learnt(random, 60, [(-90, 0), (-40, 0.3), (0, 0), (-90, 4)][seed])
    # courses over other factors are not those at a zero in the middle of the torques, where nothing changes
    assert abs(page.start["torque_n_m"]) > 20
    assert min(np.ptp(page.along("joint_angle_deg")[1], axis=0)[: len(page.quantities)]) > 0
    assert ("torque" in page.held) == (seed != 2)
    for _ in range(20):
        at = {name: random.uniform(each["low"], each["high"]) for name, each in page.surrogate.factors.items()}
        for zero in ("torque_n_m", "joint_angle_deg")[: 1 if seed == 3 else 2]:
            assert page.at(**{**at, zero: 0.0}) == [(0.0, 0.0)] * len(page.quantities)
        mirrored = {**at, **{name: -at[name] for name in SKEWS if name in at}}
        here, there = (page.surrogate.predict(page.surrogate.encoded(**values))[0] for values in (at, mirrored))
        parity = np.array([1 if each.order % 2 else -1 for each in page.surrogate.components])
        assert there == pytest.approx(parity * here, abs=1e-9 * np.abs(here).max())
    half = {**page.start, "torque_n_m": 45.0}
    columns = {name: np.array([value]) for name, value in half.items()}
    assert page.at(**half)[third_of(page)][0] == pytest.approx(abs(wave(columns, shape)[0, 3]), rel=0.1)


@pytest.mark.slow
def test_bands_hold_unseen_points_near_zero_and_far():
    """Of 400 other points at least 85 % lie within the band, near the zeros as elsewhere."""
    random = np.random.default_rng(7)
    cube, shape, page = learnt(random, 80, (-90, 0))
    study = parse_study(cube.attrs["study"].replace("samples = 80\nseed = 1", "samples = 400\nseed = 9"))
    columns = make_points(study).columns
    truth = np.abs(wave(columns, shape)[:, 3])
    rows = [{name: column[row] for name, column in columns.items()} for row in range(400)]
    third = third_of(page)
    inside = np.array(
        [abs(at[0] - value) <= at[1] for at, value in zip((page.at(**row)[third] for row in rows), truth, strict=True)]
    )
    near = np.abs(columns["torque_n_m"]) < 20
    assert inside[near].mean() > 0.85
    assert inside[~near].mean() > 0.85


@pytest.mark.parametrize(("model", "error"), [("equilibrium", 1e-9), ("kinetostatic", 1e-3)])
@pytest.mark.parametrize("seed", range(3))
def test_the_joint_has_what_its_outputs_declare(model, error, seed):
    """Exact physics: no thrust without torque, angle or friction; reversed skews reverse the even orders.

    The needles of `kinetostatic` have not settled: their history is in the second order, hardly in the third.
    """
    random = np.random.default_rng(seed)
    values = {
        "model": model,
        "joint_angle_deg": random.uniform(4, 14),
        "torque_n_m": random.uniform(20, 200) * random.choice([-1, 1]),
        "needle_sliding_friction": random.uniform(0.01, 0.04),
        "samples_per_revolution": 60,
    }
    skews = dict(zip(SKEWS, random.uniform(-0.6, 0.6, 3), strict=True))
    for name in OUTPUT.zero_at:
        result = td.simulate(**{**values, **skews, name: 0})
        if int(result["outcome"]) == Outcome.FINISHED:
            assert not result["thrust_amplitude"].values.any(), name

    def orders(sign):
        result = td.simulate(**values, **{name: sign * skew for name, skew in skews.items()})
        return result["thrust_amplitude"].values * np.exp(1j * np.radians(result["thrust_phase_deg"].values))

    here, there = orders(1), orders(-1)
    parity = np.where(np.arange(13) % 2, 1, -1)
    known = slice(None) if model == "equilibrium" else 3
    assert there[known] == pytest.approx((parity * here)[known], abs=error * np.abs(here).max())

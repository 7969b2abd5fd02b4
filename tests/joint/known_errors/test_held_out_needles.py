"""Joints that neither the law of the needles nor the record of errors was made from, run with every needle as a body."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tripod_doe.analyses.fit.model_error import model_error
from tripod_doe.joint.force_balance.kinetostatic import solve_kinetostatic
from tripod_doe.joint.known_errors.error_estimate import known_errors
from tripod_doe.joint.known_errors.other_orders import deviations_of_orders
from tripod_doe.joint.orders import complex_amplitudes
from tripod_doe.joint.simulator import simulator
from tripod_doe.joint.unit_conversion import point_values

SAMPLES = 360
HELD_OUT = pd.read_csv(Path(__file__).with_name("needles_held_out.csv"), comment="#")
IN_COAST = Path(__file__).with_name("needles_in_coast.jsonl")
VARIED = [name for name in HELD_OUT if name in simulator.parameters]


@pytest.fixture(scope="module")
def balances():
    """Complex orders of kinetostatic over those of needles, shape (point, order), and its mean skews in deg."""
    orders, skews = [], []
    for _, row in HELD_OUT.iterrows():
        found = solve_kinetostatic(point_values({"relative_tolerance": 1e-6, **row[VARIED].to_dict()}), SAMPLES)
        assert found.settled.all()
        needles = [row[f"amplitude_{k}"] * np.exp(1j * np.radians(row[f"phase_{k}_deg"])) for k in (2, 3)]
        orders.append(complex_amplitudes(found.groove_thrust.sum(axis=1))[0, 2:4] / needles)
        skews.append(np.degrees(found.needle_skew[0][:, -2 * SAMPLES :].mean(axis=1)))
    return np.array(orders), np.array(skews)


def test_the_law_of_the_needles_holds_where_it_was_not_looked_at(balances):
    """Measured: third order 0.26 (0.98) %, second 5.7 (21) % where it is above 0.5 % of the third, phase 1.3 (8.1) deg,
    skew 0.03 deg, in the median (90th percentile); of which needles' own error is 0.14 (0.24) and 2.3 (4.9) %.

    Of the 19 second orders, 15 are within 12 %, the others off by 16, 18, 35 and 41 %. While loads along needles jumped
    from end to end, a sixteenth was within 12 %, by chance or not.
    """
    orders, skews = balances
    counts = (HELD_OUT["amplitude_2"] > 0.005 * HELD_OUT["amplitude_3"]).to_numpy()
    third, second = np.abs(np.abs(orders[:, 1]) - 1), np.abs(np.abs(orders[counts, 0]) - 1)
    assert counts.sum() == 19
    assert np.median(third) < 0.004
    assert np.quantile(third, 0.9) < 0.012
    assert np.median(second) < 0.08
    assert np.sort(second)[14] < 0.12
    assert np.quantile(second, 0.9) < 0.3
    assert np.median(np.abs(np.degrees(np.angle(orders[counts, 0])))) < 3
    apart = skews - HELD_OUT[[f"skew_{k}_deg" for k in (1, 2, 3)]].to_numpy()
    assert np.median(np.abs(apart)) < 0.05


def test_the_interval_of_one_record_is_as_wide_as_it_must_be(balances):
    """Measured: all 24 third orders are within the stated 95 %, five beyond 0.59 %, which one deviation alone would be."""
    given = {name: HELD_OUT[name].tolist() for name in VARIED} | {"model": ["kinetostatic"] * len(HELD_OUT)}
    columns = {name: simulator.parameters[name].column(column) for name, column in given.items()}
    block = simulator.columns({}, columns, len(HELD_OUT))
    predicted = np.abs(balances[0][:, 1:]) * HELD_OUT[["amplitude_3"]].to_numpy()
    stated = model_error(simulator, block, [3], predicted.astype(complex), "recorded").whole
    off = np.abs(predicted - HELD_OUT[["amplitude_3"]].to_numpy())
    assert (off <= 1.96 * stated).sum() >= 22
    assert (off > 1.96 * 0.003 * predicted).sum() >= 4  # the floor of a deviation by itself would be too short


def test_second_orders_and_phases_are_within_their_stated_errors(balances):
    """Measured: 21 of 24 second orders within 95 %, two just beyond, and with the errors stated before 20, which left phases
    out; 20 of 20 phases of the second order that are stated, 22 of 24 of the third.
    """
    hits, phases = [], {2: [], 3: []}
    for (second, third), (_, row) in zip(balances[0], HELD_OUT.iterrows(), strict=True):
        amplitude = np.zeros(13)
        amplitude[2], amplitude[3] = abs(second) * row["amplitude_2"], abs(third) * row["amplitude_3"]
        columns = simulator.columns({name: row[name] for name in VARIED}, {}, 1)
        sizes, turned = (each[0] for each in deviations_of_orders(simulator, columns, amplitude[None]))
        hits.append(abs(amplitude[2] - row["amplitude_2"]) <= 1.96 * sizes[2])
        for order, ratio in ((2, second), (3, third)):
            if np.isfinite(turned[order]):
                phases[order].append(abs(np.degrees(np.angle(ratio))) <= 1.96 * turned[order])
    assert sum(hits) >= 21
    assert len(phases[2]) >= 10
    for each in phases.values():
        assert np.mean(each) >= 0.85


@pytest.mark.parametrize("model", ["equilibrium", "kinetostatic"])
def test_orders_and_phases_in_coast_are_within_their_stated_errors(model):
    """Joints of `benchmarks/other_orders.py --coast --seed 2`, part of what the factors for coast were chosen on.

    Regression: with the errors of drive, 80 % of the amplitudes of `kinetostatic` were within 95 %, 73 % of its phases.
    """
    joints, amplitudes, phases = zip(*map(json.loads, IN_COAST.read_text().splitlines()), strict=True)
    columns = {name: np.array([joint[name] for joint in joints]) for name in joints[0]}
    block = simulator.columns({"model": model}, columns, len(joints))
    outputs = simulator.simulate(block, ["thrust_amplitude", "thrust_phase_deg"]).outputs
    own, phase = (outputs[name].data for name in ("thrust_amplitude", "thrust_phase_deg"))
    sizes, turned = deviations_of_orders(simulator, block, own)
    off, apart = np.abs(own - amplitudes) / sizes, np.abs((phase - np.array(phases) + 180) % 360 - 180) / turned
    assert np.mean(off[np.isfinite(off)] <= 1.96) > 0.9
    assert np.mean(apart[np.isfinite(apart)] <= 1.96) > 0.9


def test_stated_limits_and_ranges_hold_where_nothing_was_measured(balances):
    """Measured: all 24 errors are within the limit that nine in ten should keep, 18 of 18 in all ranges within 5 %."""
    error = np.abs(np.abs(balances[0][:, 1]) - 1)
    given = {name: HELD_OUT[name].tolist() for name in VARIED} | {"model": ["kinetostatic"] * len(HELD_OUT)}
    columns = {name: simulator.parameters[name].column(column) for name, column in given.items()}
    block = simulator.columns({}, columns, len(HELD_OUT))
    _, limit, _ = known_errors("kinetostatic", block)
    assert np.isfinite(limit).all()
    assert (error <= limit).sum() >= 20
    inside = ~np.any([departure.outside for departure in simulator.model_errors(block).departures], axis=0)
    assert inside.sum() == 18
    assert (error[inside] < 0.05).all()

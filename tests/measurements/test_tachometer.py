"""Tachometers as rigs have them: bounces, spikes, missing pulses, and numbers of pulses that are inferred."""

from __future__ import annotations

import re

import numpy as np
import pytest
from measured import Recorder

from tripod_doe.errors import InputError
from tripod_doe.measurements.measurement import read_measurement
from tripod_doe.measurements.tachometer import angle_between_pulses, find_pulses, infer_pulses, mended


def bounced(table, random, part=1.0):
    """A square wave whose rising edges fall back once or twice within a few samples."""
    tacho = table["tacho"].to_numpy().copy()
    for edge in np.flatnonzero(np.diff(tacho) > 2):
        if random.random() < part:
            for gap in (2, 5)[: random.integers(1, 3)]:
                tacho[edge + gap] = 0.0
    return tacho


@pytest.mark.parametrize("pulses", [1, 6, 36])
def test_bounced_pulses_are_counted_once(pulses):
    """Exact: the angle is that of the clean tachometer."""
    table = Recorder(rpm=(500, 700), pulses=pulses).record()
    time = table["time_s"].to_numpy()
    clean = find_pulses(time, table["tacho"].to_numpy())
    got = find_pulses(time, bounced(table, np.random.default_rng(1)))
    assert got.times == pytest.approx(clean.times, abs=1e-9)
    assert got.numbers.tolist() == clean.numbers.tolist()
    assert got.extra >= clean.times.size - 1
    assert clean.extra == 0


def test_rounded_times_that_repeat_are_those_of_even_samples(tmp_path):
    """Exact: a recorder of 2 kHz that writes milliseconds, with dropouts, is read as one that writes all digits."""
    table = Recorder(rate_hz=2000.0).record()
    table.loc[[40, 41, 900], "thrust_n"] = np.nan
    table.loc[[70, 71], "tacho"] = np.nan
    table.to_csv(tmp_path / "whole.csv", index=False)
    table.assign(time_s=table["time_s"].round(3)).to_csv(tmp_path / "rounded.csv", index=False)
    whole, rounded = (read_measurement(tmp_path / f"{name}.csv", 1) for name in ("whole", "rounded"))
    assert rounded.rotation_deg == pytest.approx(whole.rotation_deg, abs=1.0)
    assert "sampled at 2,000 Hz" in rounded.remarks[0]
    assert not whole.remarks
    table["time_s"] = np.repeat(table["time_s"].to_numpy()[::2] ** 1.5, 2)[: len(table)]
    table.to_csv(tmp_path / "uneven.csv", index=False)
    with pytest.raises(InputError, match="time_s must grow from row to row"):
        read_measurement(tmp_path / "uneven.csv", 1)


@pytest.mark.parametrize(
    ("start", "factor", "message"),
    [(1.71e12, 1e3, "later than 2096"), (45_361.427, 1 / 86_400, "turns at 5.18e+07 rpm by its times")],
)
def test_times_in_milliseconds_since_1970_or_in_days_are_not_seconds(tmp_path, start, factor, message):
    """Regression: the record turned at 0.6 or at 52 million rpm, and was compared."""
    time_s = np.arange(0, 1, 1e-3)
    rows = [f"{start + factor * t:.12f},{np.sin(60 * np.pi * t):.6f},{3600 * t % 360:.3f}" for t in time_s]
    (tmp_path / "record.csv").write_text("\n".join(["timestamp,thrust_n,rotation_deg", *rows]))
    with pytest.raises(InputError, match=re.escape(message)):
        read_measurement(tmp_path / "record.csv")
    unit = {"time_s": f"timestamp [{'ms' if factor > 1 else 'days'}]"}
    assert np.ptp(read_measurement(tmp_path / "record.csv", columns=unit).time_s) == pytest.approx(0.999, rel=1e-3)


def test_spikes_between_pulses_are_dropped_and_missing_pulses_counted():
    random = np.random.default_rng(0)
    true = np.arange(60.0)
    edges = np.delete(true, [7, 30, 31])
    spikes = np.array([3.4, 15.5, 40.62])
    got = mended(np.sort(np.concatenate([edges + random.normal(0, 0.005, edges.size), spikes])))
    assert got.extra == 3
    assert got.lost == 3
    assert got.numbers.tolist() == edges.astype(int).tolist()


def test_a_spike_beyond_the_range_hides_no_pulse():
    table = Recorder().record()
    time, tacho = table["time_s"].to_numpy(), table["tacho"].to_numpy().copy()
    clean = find_pulses(time, tacho)
    tacho[[500, 3000]] = 80.0
    assert find_pulses(time, tacho).times == pytest.approx(clean.times, abs=1e-9)


def test_a_bounce_whose_pulse_began_before_the_record_is_none():
    edges = np.concatenate([[-0.86], np.arange(8.0)])
    assert mended(edges).times.tolist() == np.arange(8.0).tolist()
    assert mended(-edges[::-1]).times.tolist() == np.arange(-7.0, 1.0).tolist()
    run_down = 30 - np.sqrt(900 - 20 * np.arange(30.0))
    assert mended(run_down).times.size == 30


def test_the_longer_part_beside_an_uneven_interval_is_kept():
    edges = np.concatenate([np.arange(20.0), 19.5 + np.arange(1.0, 41.0)])
    got = mended(edges)
    assert got.times[0] == 20.5
    assert got.times.size == 40
    with pytest.raises(InputError, match="irregular"):
        mended(np.sort(np.random.default_rng(0).uniform(0, 50, 60)))


@pytest.mark.parametrize("pulses", [1, 2, 3, 6, 60, 360])
@pytest.mark.parametrize(
    "orders",
    [
        {0: (2.0, 0), 1: (1.0, 10), 2: (4.0, 40), 3: (14.0, -75)},
        {0: (40.0, 0), 2: (5.0, 40), 3: (3.0, -75), 6: (0.4, 0)},
    ],
)
@pytest.mark.parametrize("known", [True, False])
def test_the_number_of_pulses_is_inferred_and_stated(pulses, orders, known):
    recorder = Recorder(orders, rpm=(600, 600), pulses=pulses, rate_hz=20_000, noise_n=0.2)
    table = recorder.record()
    time, thrust = table["time_s"].to_numpy(), table["thrust_n"].to_numpy()
    got = find_pulses(time, table["tacho"].to_numpy())
    between = (time >= got.times[0]) & (time <= got.times[-1])
    count, said = infer_pulses(got, time[between], thrust[between], 597.0 if known else None)
    assert count == pulses
    assert (str(pulses) in said) == (pulses > 1)
    turned = angle_between_pulses(got, time[between], count)
    true = table["true_deg"].to_numpy()[between]
    assert np.abs(turned - turned[0] - true + true[0]).max() < 0.5


def test_pulses_that_come_faster_than_they_are_sampled_are_named_as_such():
    """A pulse every 2.6 samples; between edges that are seen lie two or three."""
    time = np.arange(13000) / 5000
    with pytest.raises(InputError, match="irregular, one about every 3 samples"):
        find_pulses(time, (time * 5000 / 2.6 % 1 < 0.4).astype(float))


def test_a_column_of_speeds_is_no_tachometer(tmp_path):
    """Regression: of a speed that jumps between two values, each jump was a pulse, and the third order 0.1 N for 20 N."""
    time = np.arange(0, 2, 1e-3)
    rows = np.column_stack([time, 20 * np.cos(2 * np.pi * 15 * time), np.where(time % 0.4 < 0.2, 200, 400)])
    np.savetxt(tmp_path / "steps.csv", rows, "%.6f", ",", header="Time [s],Axial force [N],Speed [rpm]", comments="")
    with pytest.raises(InputError, match="no column tacho"):
        read_measurement(tmp_path / "steps.csv")

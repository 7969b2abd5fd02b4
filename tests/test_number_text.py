"""Numbers as people write them."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tripod_doe.number_text import (
    chance_in_percent,
    count_of,
    digits_apart,
    duration,
    interval,
    level,
    levels_apart,
    number,
    numbers_in_words,
    pace,
    r2_text,
    rounded_down,
    rounded_up,
    size,
    squared,
    text_range,
    value_range,
    value_with_ends,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (100.4, "100"),
        (99.96, "100"),
        (64.41, "64.4"),
        (40.02, "40"),
        (0.0190123, "0.019"),
        (-3.14159, "-3.14"),
        (1234.5, "1230"),
        (12345, "12,300"),
        (3.2e-14, "3.2e-14"),
        (1e-5, "1e-5"),
        (0.00012345, "0.000123"),
        (2.5e9, "2.5e9"),
        (math.nan, "not known"),
        (math.inf, "infinite"),
    ],
)
def test_three_significant_digits(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("r2", "text"),
    [(0.99996, "> 0.9999"), (1.0, "> 0.9999"), (0.99989, "= 0.9998"), (0.5, "= 0.5000"), (0.0, "= 0.0000")],
)
def test_r2_below_one_does_not_read_one(r2, text):
    """Regression: "R2 1" for 0.99996."""
    assert r2_text(r2) == text


def test_given_values_keep_their_digits():
    assert [level(value) for value in (1499, 8.25, 0.005, 0.1 + 0.2, 23456)] == [
        "1499",
        "8.25",
        "0.005",
        "0.3",
        "23,456",
    ]


def test_a_number_reads_back_to_three_digits():
    draw = random.Random(0)
    for _ in range(2000):
        value = draw.choice((-1, 1)) * 10 ** draw.uniform(-20, 20)
        assert float(number(value).replace(",", "")) == pytest.approx(value, rel=0.006)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0, "0 s"),
        (4e-5, "40 us"),
        (0.0034, "3.4 ms"),
        (0.5, "0.5 s"),
        (0.05, "50 ms"),
        (0.99996, "1 s"),
        (68.34, "68.3 s"),
        (100.0, "100 s"),
        (119.99, "2 min"),
        (3600, "60 min"),
        (7200, "2 h"),
        (400_000, "4.63 d"),
    ],
)
def test_durations_have_the_unit_that_suits_them(seconds, text):
    assert duration(seconds) == text


def test_a_slow_pace_is_a_time_per_point():
    assert pace(3, 36.6) == "12.2 s per point"
    assert pace(1664, 4.0) == "416 points per second"
    assert pace(0, 4.0) == ""


def test_a_bound_holds_after_rounding():
    draw = random.Random(1)
    for _ in range(2000):
        value = 10 ** draw.uniform(-6, 6)
        told = float(rounded_up(value).replace(",", ""))
        assert value <= told <= 1.1 * value
    assert [rounded_down(value) for value in (0.29, 0.0, 31, 215.4, 1.1)] == ["0.29", "0", "31", "210", "1.1"]
    assert [rounded_up(value) for value in (0.3, 0.0, 31, 0.301)] == ["0.3", "0", "31", "0.31"]


def test_intervals_keep_the_digits_that_are_known():
    assert interval(0.55712, 0.0613) == "0.557 +- 0.061"
    assert interval(14.1234, 3e-9) == "14.1"  # rounding
    assert interval(14.1234, 3e-7) == "14.1234 +- 3e-7"  # 14.12 would lie outside
    assert interval(0.0, 0.01) == "0 +- 0.01"
    assert interval(7e-6, 0.014) == "0 +- 0.014"
    assert interval(0.0016, 0.014) == "0.002 +- 0.014"
    assert interval(14.1234, 0.0) == "14.1"
    assert interval(-2.0, 1.5e-15) == "-2"  # rounding
    assert interval(14.1234, math.nan) == "14.1"


def test_counts_and_sizes():
    assert [count_of(1, "point"), count_of(0, "point"), count_of(1664, "point")] == [
        "1 point",
        "0 points",
        "1,664 points",
    ]
    assert [size(0), size(999.9), size(7200), size(1.7e10)] == ["0 bytes", "1 kB", "7.2 kB", "17 GB"]


def test_numbers_that_differ_look_different():
    assert digits_apart(1.0, 2.0) == digits_apart(1.001, 2.0) == 3
    assert digits_apart(6.9400, 6.9416) == 4
    assert digits_apart(0.1, 0.1 + 1e-9) == 9
    assert digits_apart(0.1, 0.1) == 16
    assert digits_apart(1.0, math.inf) == 3


@settings(max_examples=200, deadline=None)
@given(st.floats(1e-6, 1e6), st.floats(1e-9, 10))
@example(1e-5, 1e-7)
def test_a_difference_is_written_in_its_size(low, part):
    """Regression: "from 37.7 to 37.6 N" for a change of 0.0008 N."""
    high = low * (1 + part)
    digits = digits_apart(low, high)
    written = float(number(high, digits).replace(",", "")) - float(number(low, digits).replace(",", ""))
    assert written == pytest.approx(high - low, rel=0.51)


def test_ends_of_a_range_look_different():
    assert value_range(1.0131, 1.0142, "N") == "1.013 to 1.014 N"
    assert value_range(2.0, 2.0, "N") == "2 N"
    assert text_range("22", "22", "mm") == "22 mm"
    assert text_range("21", "22", "mm") == "21 to 22 mm"
    assert value_range(1.0, 1.0 + 1e-9) == "1"
    assert value_with_ends(1.0136, 1.0131, 1.0142, "N") == "1.014 N (1.013 to 1.014)"


def test_levels_in_a_legend_are_short_and_differ():
    assert levels_apart([61.66666, 7.44444, 1499, 0.005]) == ["61.67", "7.444", "1499", "0.005"]
    assert levels_apart([1.00001, 1.00002]) == ["1.00001", "1.00002"]


@pytest.mark.parametrize(("unit", "square"), [("N", "N^2"), ("N m", "(N m)^2"), ("mm/s", "(mm/s)^2"), ("", "")])
def test_a_variance_has_the_square_of_the_unit(unit, square):
    assert squared(unit) == square


def test_runs_of_numbers_are_written_by_their_ends():
    assert numbers_in_words([12, 1, 4, 5, 6, 6]) == "1, 4 to 6 and 12"
    assert numbers_in_words([2, 3]) == "2 and 3"
    assert numbers_in_words(range(1, 13)) == "1 to 12"


@pytest.mark.parametrize(
    ("chance", "text"),
    [
        (0.0, "0"),
        (0.004, "0.4"),
        (0.123, "12"),
        (0.5, "50"),
        (0.854, "85"),
        (0.995, "99.5"),
        (0.99966, "99.966"),
        (1.0, "100"),
    ],
)
def test_a_chance_below_one_is_not_a_hundred_per_cent(chance, text):
    """Regression: "100 % (100 %)" of a chance of 0.9997 between 0.998 and 1."""
    assert chance_in_percent(chance) == text

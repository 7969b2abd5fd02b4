"""Expressions are parsed, never evaluated as Python."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tripod_doe.errors import InputError
from tripod_doe.study.expressions import Expression
from tripod_doe.study.named_arrays import NamedArray

COLUMNS = {"a": np.array([1.0, 2.0, np.nan]), "b": np.array([2.0, 2.0, 2.0]), "s": np.array(["x", "y", "x"], object)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a < b", [True, False, False]),
        ("not a < b", [False, True, True]),
        ("0 < a <= 2 and s == 'y'", [False, True, False]),
        ("abs(a - b) > 0.5 or s == 'x'", [True, False, True]),
        ("max(a, b) ** 2 == 4", [True, True, False]),
        ("b == 2", [True, True, True]),
        ("a != b", [True, False, False]),  # of NaN nothing is known
        ("1 < 2", [True, True, True]),
    ],
)
def test_conditions(text, expected):
    assert Expression(text, COLUMNS)(COLUMNS).tolist() == expected


PHASES = {"p": np.array([170.0, 10.0, -170.0]), "q": np.array([-170.0, 0.0, 170.0])}


@pytest.mark.parametrize(
    "text",
    ["p - q < 0", "-(q - p) < 0", "+(p - q) < 0", "(p - q) / 2 < 0", "max(p - q, -50) < 0", "0.5 * (p - q) < 0",
     "p - q + 0 < 0"],
)  # fmt: skip
def test_differences_of_phases_are_by_the_shorter_way_anywhere(text):
    """Regression: beside a sign, a factor or a function they were not, and the same condition chose other rows."""
    assert Expression(text, PHASES, phases=PHASES, is_condition=True)(PHASES).tolist() == [True, False, False]


def test_conditions_compute_in_float64():
    """Regression: float32 of a cube from another program overflowed."""
    single = {"s": np.array([1e20, 1.0], np.float32)}
    assert Expression("s * s * 0 == 0", single)(single).tolist() == [True, True]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("__import__('os').system('true')", "not allowed"),
        ("a.real < 1", "not allowed"),
        ("[a for a in b]", "not allowed"),
        ("lambda: 1", "not allowed"),
        ("a <", "not an expression"),
        ("a = 3", "write == to compare"),
        ("aa < 1", "did you mean 'a'"),
        ("abs(a, b) < 1", "arguments"),
        ("a @ b", "not allowed"),
    ],
)
def test_anything_else_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        Expression(text, ["a", "b"])


@pytest.mark.parametrize("text", ["9**9**9 > a", "-9**9**9 < a", "a < 9**9**9**9", "1 / 0 > a"])
def test_numbers_without_bounds_are_infinite(text):
    """Regression: whole numbers were Python's, and 9**9**9 took forever."""
    started = time.perf_counter()
    assert Expression(text, COLUMNS)(COLUMNS).tolist() == [True, True, False]
    assert time.perf_counter() - started < 1


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, np.uint8, np.uint64])
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("n * n * n * n * n > 5e9", [False, False, True]),
        ("n ** 5 > 5e9", [False, False, True]),
        ("2 - n < 0", [False, True, True]),
        ("-n < 0", [True, True, True]),
        ("n ** -n < 0.05", [False, True, True]),
        ("1 / (n - 1) > 1e300", [True, False, False]),
        ("n / 2 == 1.5", [False, True, False]),
        ("abs(n - 200) > 150", [True, True, False]),
        ("(n > 1) + (n > 2) == 2", [False, True, True]),
        ("-(n > 1) == -1", [False, True, True]),
    ],
)
def test_whole_numbers_are_those_of_float64(kind, text, expected):
    """Regression: int32 overflowed in silence, and a negative power was an internal error."""
    assert Expression(text, ["n"])({"n": np.array([1, 3, 100], kind)}).tolist() == expected


def test_numbers_that_float64_does_not_hold_are_refused():
    with pytest.raises(InputError, match="9,007,199,254,740,992"):
        Expression("n > 9007199254740993", ["n"])
    with pytest.raises(InputError, match="n has whole numbers beyond"):
        Expression("n > 1", ["n"])({"n": np.array([2**53 + 1])})
    assert Expression("n < 100000000000000000000", ["n"])({"n": np.array([2**53])}).tolist() == [True]
    with pytest.raises(InputError):
        Expression("n > " + "9" * 400, ["n"])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a - 1", [False, True, False]),
        ("a and 1", [True, True, False]),
        ("a or 0", [True, True, False]),
        ("not a", [False, False, True]),
    ],
)
def test_nan_alone_is_no_yes(text, expected):
    assert Expression(text, COLUMNS)(COLUMNS).tolist() == expected


@pytest.mark.parametrize(
    "text", ["s == 0", "s != 1", "a == '1'", "a < b == 'x'", "'x' == 1", "s < 5", "(a < b) == 'True'"]
)
def test_a_number_and_a_text_are_not_compared(text):
    """Regression: false, or for != true, in silence; so `outcome == 0` found nothing."""
    with pytest.raises(InputError):
        Expression(text, COLUMNS)(COLUMNS)


@pytest.mark.parametrize("depth", [90, 101, 1500, 3999, 100_000, 2_000_000])
@pytest.mark.parametrize("form", ["+{}a", "({}a", "not {}a", "{}a", "a+{}", "a<{}"])
def test_deep_and_long_conditions_are_refused_or_answered(form, depth):
    """Regression: 100,000 signs ended in a RecursionError."""
    before, after = form.split("{}")
    text = before * depth + after * depth + "a"
    complaint = ""
    try:
        Expression(text, COLUMNS)(COLUMNS)
    except InputError as error:
        complaint = str(error)
    assert len(complaint) < 400


@given(st.text("abs19.*+-/<>=!()[],:' \"\n\x00noterdmix_", max_size=40))
def test_any_text_is_answered_or_refused(text):
    with suppress(InputError):
        assert Expression(text, COLUMNS)(COLUMNS).shape == (3,)


def test_values_that_cannot_be_compared():
    with pytest.raises(InputError, match="compares a number with a text"):
        Expression("s < 1", COLUMNS)(COLUMNS)


class Grid:
    """A cube of two points with a waveform, for formulas."""

    rows, most = ("point",), 1000

    def read(self, name, whole):
        angle = np.array([0.0, 90.0, 180.0])
        values = {"wave": (("point", "angle"), [[0, 3, -1], [0, 6, -2]]), "a": (("point",), [1, 2])}
        dims, data = values[name]
        return NamedArray(dims, np.array(data), {"angle": angle} if "angle" in dims else {})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("wave[90] / a", [3, 3]),
        ("max(wave[90:])", [3, 6]),
        ("sum(wave) + mean(wave)", [2 + 2 / 3, 4 + 4 / 3]),
        ("max(a * wave, 'angle')", [3, 12]),
        ("max(a, 1.5, wave[0])", [1.5, 2]),
        ("log10(100)", 2),
    ],
)
def test_labels_and_reductions(text, expected):
    """Exact: by hand."""
    assert Expression(text, ["wave", "a"]).numbers(Grid()).data == pytest.approx(np.array(expected))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 + wave[45]", "at character 5: wave: no angle 45; it has 0, 90, 180"),
        ("wave[90:80]", "no angle 90:80"),
        ("wave[0, 90]", "dimension angle"),
        ("a[0]", "one value for a point"),
        ("wave[a]", "brackets take labels"),
        ("wave[::2]", "range is two numbers"),
        ("wave['x']", "no angle 'x'"),
        ("mean(wave, a)", "wrong number of arguments for mean"),
        ("mean()", "wrong number"),
        ("sum(a)", "single value"),
        ("wave[0:90] * wave[90:180]", "different angle"),
        ("wave if a else 1", "not allowed"),
        ("'text'", "a text, not a number"),
    ],
)
def test_what_labels_and_reductions_cannot_do(text, message):
    with pytest.raises(InputError, match=message):
        Expression(text, ["wave", "a"]).numbers(Grid())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1/0", "not a condition: it names"),
        ("s", "a text is not a condition"),
        ("'x'", "not a condition"),
        ("s + 1 > 2", "a text cannot be calculated with"),
        ("s * s > 2", "a text cannot be calculated with"),
        ("-s > 2", "a text cannot be calculated with"),
        ("sqrt(s) > 2", "a text cannot be calculated with"),
    ],
)
def test_what_is_no_condition_is_refused_in_plain_words(text, told):
    """In place of all rows, or of numpy's words about its own types."""
    with pytest.raises(InputError, match=told):
        Expression(text, COLUMNS)(COLUMNS)

"""Expressions are parsed, never evaluated as Python."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.study.expressions import Expression

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
        ("1 < 2", [True, True, True]),
    ],
)
def test_conditions(text, expected):
    assert Expression(text, COLUMNS)(COLUMNS).tolist() == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("__import__('os').system('true')", "not allowed"),
        ("a.real < 1", "not allowed"),
        ("[a for a in b]", "not allowed"),
        ("lambda: 1", "not allowed"),
        ("a <", "not an expression"),
        ("aa < 1", "did you mean 'a'"),
        ("abs(a, b) < 1", "arguments"),
        ("a @ b", "not allowed"),
    ],
)
def test_anything_else_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        Expression(text, ["a", "b"])


def test_values_that_cannot_be_compared():
    with pytest.raises(InputError, match="not supported"):
        Expression("s < 1", COLUMNS)(COLUMNS)

"""Numbers that people type, wherever they type them."""

import pytest

from tripod_doe.analyses.comparison.comparison import parse_speeds
from tripod_doe.cli.parser import parameter_value
from tripod_doe.errors import InputError
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.study.query.selection import parse_selection
from tripod_doe.typed_numbers import readings, typed_number


@pytest.mark.parametrize("text", ["1_000", "\uff11\uff12", "\u0661\u0662"])
def test_only_plain_digits_are_numbers(text):
    """Regression: Python's float takes each for a number."""
    assert float(text)
    with pytest.raises(ValueError, match="could not convert"):
        typed_number(text)
    with pytest.raises(InputError, match="expected a number"):
        parameter_value(JOINT_PARAMETERS["torque_n_m"], text, "torque-n-m")
    with pytest.raises(InputError, match="expected a number"):
        JOINT_PARAMETERS["torque_n_m"].typed(text)
    with pytest.raises(InputError, match="two speeds"):
        parse_speeds(f"1:{text}")
    assert parse_selection(f"torque_n_m={text}").values == (text,)  # a label, which no number has


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1,200", [1.2, 1200]),
        ("1.200", [1.2, 1200]),
        ("1'200", [1200]),
        ("1.200,5", [1200.5]),
        ("0,125", [0.125]),
        ("25,50,100", []),
        ("1_0", []),
    ],
)
def test_what_a_number_may_mean(text, values):
    assert readings(text) == values

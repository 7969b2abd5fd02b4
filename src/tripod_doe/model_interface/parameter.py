"""Parameters with unit, symbol, meaning, range and source; help, schema, cubes and reports are made from them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import MOST_MESSAGES, InputError, near_match
from tripod_doe.typed_numbers import typed_number

_LONGEST_SHOWN = 80  # characters of a value in a message

Value = float | int | str | None
Kind = Literal["number", "integer", "switch", "choice", "argument"]


@dataclass(frozen=True)
class Parameter:
    """One input of a simulator."""

    name: str  # its name in study files, Python, command line, cubes and tables
    default: Value  # its value if not given; None if another parameter, the model or the method decides
    unit: str  # UDUNITS spelling; ``"1"`` without dimension
    symbol: str  # the field's symbol, if possible as in the paper
    meaning: str  # one phrase in the field's words
    source: str  # a place in the paper, or the word "assumed"
    # low, high: range of allowed values, ends included unless `low_open`
    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    # ``number``, ``integer``, ``switch`` (0 or 1), ``choice``, or ``argument`` of a user function: a number or a text
    # that is passed on unchanged
    kind: Kind = "number"
    choices: tuple[str, ...] = ()  # allowed words of a choice
    group: str = "parameters"  # heading under which help and documentation list it
    follows: str | None = None  # name of the parameter whose value it takes if not given

    @property
    def range_text(self) -> str:
        """The allowed values in words, as help texts and errors show them."""
        if self.kind == "choice":
            return "one of " + ", ".join(self.choices)
        if self.kind == "switch":
            return "0 or 1"
        if math.isinf(self.low) and math.isinf(self.high):
            return "any finite number"
        lower = f"{'>' if self.low_open else '>='} {self.low:g}" if math.isfinite(self.low) else ""
        upper = f"<= {self.high:g}" if math.isfinite(self.high) else ""
        return " and ".join(part for part in (lower, upper) if part)

    def check(self, value: object) -> Value:
        """Return `value` as this parameter's type.

        Raises:
            InputError: If the value has the wrong type, is not finite or lies outside the range.
        """
        if value is None:
            if self.default is None:
                return None
            raise InputError(f"{self.name}: a value is needed ({self.range_text})")
        if self.kind == "choice":
            if not isinstance(value, str) or value not in self.choices:
                raise InputError(f"{self.name} = {_shown(value)}: unknown{near_match(str(value), self.choices)}")
            return value
        if self.kind == "argument" and isinstance(value, bool | str):
            if isinstance(value, str) and "\0" in value:  # netCDF ends a text there: levels would share a name
                raise InputError(f"{self.name} = {_shown(value)}: a text with a NUL, which no cube holds")
            return value
        if isinstance(value, bool):
            value = int(value) if self.kind == "switch" else value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{self.name} = {_shown(value)}: expected a number ({self.range_text})")
        if not _is_finite(value):
            raise InputError(f"{self.name} = {_shown(value)}: must be finite ({self.range_text})")
        if isinstance(value, int) and int(float(value)) != value:
            raise InputError(f"{self.name} = {value}: a whole number that float64 does not hold; give it as text")
        if self.kind == "integer" and value != int(value):
            raise InputError(f"{self.name} = {value:g}: must be a whole number ({self.range_text})")
        if self.kind == "switch" and value not in (0, 1):
            raise InputError(f"{self.name} = {value:g}: must be {self.range_text}")
        if not self.low <= value <= self.high or (self.low_open and value == self.low):
            raise InputError(f"{self.name} = {value:g}: must be {self.range_text} {self.unit_text}".rstrip())
        if self.kind == "argument":
            return value
        return int(value) if self.kind in ("integer", "switch") else float(value)

    def typed(self, text: str) -> float | str:
        """The word or the number that a text means for this parameter; `check` compares it with the range.

        Raises:
            InputError: If it is no word of a choice, or no number.
        """
        if self.kind == "choice":
            return str(self.check(text))
        try:
            return typed_number(text)
        except ValueError as error:
            raise InputError(f"{self.name} = {text!r}: expected a number ({self.range_text})") from error

    @property
    def unit_text(self) -> str:
        """The unit for people: empty where there is none."""
        return {"1": "", "degree": "deg"}.get(self.unit, self.unit)

    def column(self, values: Sequence[Value]) -> NDArray[Any]:
        """Values of several points as an array, shape (point,).

        Numbers are floats (NaN where unset), words objects (None where unset), a function's arguments as written.
        """
        if self.kind == "choice" or any(isinstance(value, str) for value in values):
            return np.array(values, dtype=object)
        return np.array(values) if self.kind == "argument" else np.array(values, dtype=float)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number of more than 308 digits
        return False


def _shown(value: object) -> str:
    """A value as a message shows it: a long value is cut."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def is_set(value: object) -> bool:
    """Whether a parameter has a value: None and NaN mean no value."""
    return value is not None and value == value


def read_parameters(package: str, name: str, choices: Mapping[str, tuple[str, ...]]) -> dict[str, Parameter]:
    """Parameters by name from a TOML file of a package: a table for each, whose keys are the fields of `Parameter`.

    Its ``range`` is [low, high]; the choices of the parameters that have any may be given here.
    """
    tables = tomllib.loads(files(package).joinpath(name).read_text(encoding="utf-8"))
    return {name: _from_table(name, table, choices.get(name, ())) for name, table in tables.items()}


def _from_table(name: str, table: dict[str, Any], choices: tuple[str, ...]) -> Parameter:
    low, high = table.pop("range", (-math.inf, math.inf))
    choices = tuple(table.pop("choices", choices))
    return Parameter(name, low=low, high=high, choices=choices, **{"default": None, "unit": "1", "symbol": ""} | table)


def check_parameters(parameters: Mapping[str, Parameter], values: Mapping[str, object]) -> dict[str, Value]:
    """Check given values against their parameters.

    Raises:
        InputError: For every unknown name (with the nearest known one) and every value that its parameter refuses.
    """
    checked: dict[str, Value] = {}
    wrong: list[str] = []
    for name, value in values.items():
        if len(wrong) == MOST_MESSAGES:
            wrong.append("and maybe more like these")
            break
        try:
            if name not in parameters:
                raise InputError(f"{name} = {_shown(value)}: unknown parameter{near_match(name, parameters)}")
            checked[name] = parameters[name].check(value)
        except InputError as error:
            wrong.append(str(error))
    if wrong:
        raise InputError("\n".join(wrong))
    return checked

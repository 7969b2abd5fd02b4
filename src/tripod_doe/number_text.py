"""Numbers and names as text, for sentences, tables and lines of the terminal.

Three significant digits, powers of ten only for very large and small numbers, and a unit that suits the size.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

_DIGITS = 3
_ROUNDING = 1e-9  # part of a number up to which the half width of its interval is rounding
_MOST_APART = 6  # digits by which the ends of a range differ, beyond which they are alike
_GIVEN_DIGITS = 6  # of a value that a user wrote: enough to recognise it
_PLAIN = (1e-4, 1e7)  # magnitudes that are written without a power of ten
_GROUPED = 1e4  # from here on, digits are grouped by commas
_TIMES = (
    (86400.0, "d", 2.0),
    (3600.0, "h", 2.0),
    (60.0, "min", 2.0),
    (1.0, "s", 0.1),
    (1e-3, "ms", 1.0),
    (1e-6, "us", 1.0),
    (1e-9, "ns", 0.0),
)
_PERSONS = {"youngs": "Young's", "poissons": "Poisson's"}
_SIZES = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "bytes"))


def number(value: float, digits: int = _DIGITS) -> str:
    """A number to some significant digits, without trailing zeros: ``0.019``, ``64.4``, ``12,300``, ``3e-14``.

    Not a number is ``not known``.
    """
    if math.isnan(value):
        return "not known"
    if math.isinf(value):
        return "infinite" if value > 0 else "-infinite"
    rounded = float(f"{value:.{digits - 1}e}")
    if rounded == 0:
        return "0"
    if not _PLAIN[0] <= abs(rounded) < _PLAIN[1]:
        mantissa, exponent = f"{rounded:.{digits - 1}e}".split("e")
        return f"{_without_zeros(mantissa)}e{int(exponent)}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(rounded))), 0)
    text = f"{rounded:{',' if abs(rounded) >= _GROUPED else ''}.{decimals}f}"
    return _without_zeros(text)


def _without_zeros(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def digits_apart(low: float, high: float) -> int:
    """Significant digits, at least three, with which the difference of two numbers is written right within a half.

    16 if they are equal. With fewer, 37.6504 and 37.6496 would be 37.7 and 37.6, a hundred times as far apart.
    """
    apart = abs(high - low)
    if not math.isfinite(apart):
        return _DIGITS
    for digits in range(_DIGITS, 16):
        written = abs(float(f"{high:.{digits - 1}e}") - float(f"{low:.{digits - 1}e}"))
        if written > 0 and abs(written - apart) <= apart / 2:
            return digits
    return 16


def level(value: float) -> str:
    """A value that was given, as it was written: ``1499``, ``0.005``."""
    return number(value, _GIVEN_DIGITS)


def level_or_word(value: object) -> str:
    """A value of a parameter as text: a level, or a word."""
    return level(float(value)) if isinstance(value, int | float) else str(value)


def levels_apart(values: Iterable[float]) -> list[str]:
    """Levels of a factor in a legend: four significant digits, or as many as let neighbours look different."""
    ordered = sorted(set(map(float, values)))
    digits = max([4, *(digits_apart(low, high) for low, high in pairwise(ordered))])
    return [number(float(value), digits) for value in values]


def rounded_up(value: float, digits: int = 2) -> str:
    """A bound to some significant digits, rounded away from zero, so that "at most" holds."""
    if value == 0 or not math.isfinite(value):
        return number(value)
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    steps = math.ceil(abs(value) / unit * (1 - 1e-12))  # a value with few digits already stays as it is
    return number(math.copysign(steps * unit, value), digits + 1)


def rounded_down(value: float, digits: int = 2) -> str:
    """A bound to some significant digits, rounded towards zero, so that "at least" holds."""
    if value == 0 or not math.isfinite(value):
        return number(value)
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    steps = math.floor(abs(value) / unit * (1 + 1e-12))
    return number(math.copysign(steps * unit, value), digits + 1)


def interval(value: float, half: float) -> str:
    """A number with the half width of its interval, to the digits that this leaves: ``0.7 +- 0.05``.

    The number alone where no interval is known, or where it is exact but for rounding.
    """
    if not math.isfinite(half) or not math.isfinite(value) or half <= _ROUNDING * abs(value):
        return number(value)
    if abs(value) < 0.5 * 10.0 ** (math.floor(math.log10(abs(half))) - 1):  # beyond the digits that are left
        return f"0 +- {number(half, 2)}"
    wanted = math.floor(math.log10(abs(value))) - math.floor(math.log10(abs(half))) + 1  # to the first digit of half
    return f"{number(value, max(wanted, min(wanted + 1, _DIGITS + 1), 1))} +- {number(half, 2)}"


def value_range(low: float, high: float, unit: str = "") -> str:
    """Two ends with the digits in which they differ: ``1.012 to 1.014 N``; one number where they are alike."""
    digits = digits_apart(low, high)
    digits = _DIGITS if digits > _MOST_APART else digits
    return text_range(number(low, digits), number(high, digits), unit)


def text_range(low: str, high: str, unit: str = "") -> str:
    """Two ends that are text already: ``5 to 10 N``; one of them where they read alike."""
    return with_unit(high if low == high else f"{low} to {high}", unit)


def allowed_range(low: float, high: float, unit: str = "") -> str:
    """A range that may be open at one end, with ends as given: ``up to 0.5``, ``from 3 deg``, ``3 to 5 N``."""
    if math.isinf(high):
        return with_unit(f"from {level(low)}", unit)
    return with_unit(f"up to {level(high)}", unit) if math.isinf(low) else text_range(level(low), level(high), unit)


def value_with_ends(value: float, low: float, high: float, unit: str = "") -> str:
    """A value with the ends of its interval, with the digits in which these differ: ``1.013 N (1.012 to 1.014)``."""
    digits = min(digits_apart(low, high), _MOST_APART)
    return f"{with_unit(number(value, digits), unit)} ({value_range(low, high)})"


def r2_text(r2: float) -> str:
    """A share of explained variation, rounded down so that one below 1 does not read 1: ``= 0.9873``, ``> 0.9999``."""
    return "> 0.9999" if r2 > 0.9999 else f"= {math.floor(r2 * 1e4) / 1e4:.4f}"


def numbers_in_words(numbers: Iterable[int]) -> str:
    """Whole numbers in growing order, with runs of three and more by their ends: ``1, 4 to 9 and 12``."""
    runs: list[list[int]] = []
    for each in sorted(set(numbers)):
        if runs and each == runs[-1][-1] + 1:
            runs[-1].append(each)
        else:
            runs.append([each])
    parts = [
        text for run in runs for text in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else [f"{each}" for each in run])
    ]
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def in_words(name: str) -> str:
    """A name without underscores, and with names of persons capitalised: ``poissons_ratio`` is ``Poisson's ratio``."""
    return " ".join(_PERSONS.get(word, word) for word in name.split("_"))


def capital(text: str) -> str:
    """A text with a capital letter at its start, the others as they are."""
    return text[:1].upper() + text[1:]


def plain_json(value: Any) -> Any:
    """A value for JSON: infinite numbers and NaN, also within lists and tables, as null."""
    if isinstance(value, dict):
        return {key: plain_json(item) for key, item in value.items()}
    if isinstance(value, list):
        return [plain_json(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def with_unit(value: str, unit: str) -> str:
    """Value and unit, without a trailing blank where there is no unit."""
    return f"{value} {unit}" if unit else value


def chance_in_percent(chance: float) -> str:
    """A probability in per cent, to two digits of it or of what it lacks to one: ``0.4``, ``85``, ``99.97``."""
    lacks = 100 * (1 - chance)
    if not 0 < lacks < 50:
        return number(100 * chance, 2)
    return _without_zeros(f"{100 - lacks:.{max(1 - math.floor(math.log10(lacks)), 0)}f}")


def squared(unit: str) -> str:
    """The unit of a square, such as a variance: ``N^2``, ``(N m)^2``; none where there is no unit."""
    return f"{unit}^2" if unit.isalpha() else f"({unit})^2" if unit else ""


def count_of(count: int, thing: str) -> str:
    """A count with its noun: ``1 point``, ``1,664 points``."""
    return f"{count:,} {thing}{'s' * (count != 1)}"


def duration(seconds: float, digits: int = _DIGITS) -> str:
    """A time in the unit that suits it: ``40 us``, ``68.3 s``, ``3.5 min``, ``12 h``."""
    if not math.isfinite(seconds):
        return number(seconds)
    if seconds == 0:
        return "0 s"
    fitting = ((length, unit) for length, unit, least in _TIMES if abs(seconds) >= 0.9995 * least * length)
    length, unit = next(fitting)
    return f"{number(seconds / length, digits)} {unit}"


def pace(count: float, seconds: float, thing: str = "point") -> str:
    """The rate at which things are made: ``350 points per second``, or ``12 s per point`` at slower rates."""
    if count <= 0 or seconds <= 0:
        return ""
    if count < seconds:
        return f"{duration(seconds / count)} per {thing}"
    return f"{number(count / seconds)} {thing}s per second"


def size(count: float) -> str:
    """Bytes in the unit that suits them: ``7.2 kB``."""
    length, unit = next(((length, unit) for length, unit in _SIZES if count >= 0.9995 * length), _SIZES[-1])
    return f"{number(count / length)} {unit}"

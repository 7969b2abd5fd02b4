"""Numbers that people type: in forms, options, tables, notes and names of files.

A number has ASCII digits and a decimal point. Python also takes ``1_000`` and digits of other scripts for numbers; here
they are none.
"""

import re

_PLAIN = re.compile(r"[+-]?[0-9]+(?:[.,][0-9]+)?(?:e[+-]?[0-9]+)?", re.I)
_THOUSANDS = {
    ",": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?:\.[0-9]+)?"),
    ".": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+(?:,[0-9]+)?"),
}
"""Numbers in groups of three digits, by the sign between them."""


def typed_number(text: str) -> float:
    """The number that a text is (ValueError if it is none)."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def number_or_text(text: str) -> float | str:
    """The number that a text is, or the text."""
    try:
        return typed_number(text)
    except ValueError:
        return text


def readings(text: str) -> list[float]:
    """The numbers that a text may mean, with a decimal sign or signs between thousands: 1,200 is 1.2 or 1200."""
    text = re.sub(r"(?<=[0-9])['’](?=[0-9]{3})", "", text)
    values = [float(text.replace(",", "."))] if _PLAIN.fullmatch(text) else []
    for apart, form in _THOUSANDS.items():
        if form.fullmatch(text):
            values.append(float(text.replace(apart, "").replace(",", ".")))
    return values

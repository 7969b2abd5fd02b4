"""TOML texts: read, parsed and written; values too large for messages or readers are refused."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, closest
from tripod_doe.files.checksum_list import refuse_changed
from tripod_doe.files.regular_files import STUDY_BYTES, read_regular, text_of

_MOST_PARTS = 16
_LONGEST_SHOWN = 80  # characters of a value
_MOST_BITS = 128
_LARGEST_NUMBERS = "write a number beyond 1e38 with a decimal point or an exponent"
_LONG_NAME = re.compile(  # each sign fits one part only
    rf"""(?<![\w-])((?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{_MOST_PARTS}}}"""
)


def read_text(path: Path, what: str, most: int = STUDY_BYTES) -> str:
    """The text of a file of at most `most` bytes.

    Raises:
        InputError: If it cannot be read, is larger, is TOML but not UTF-8, or does not match its checksum.
    """
    refuse_changed(path)
    try:
        content = read_regular(path, most, links=True)
        # some editors mark UTF-8 in front
        return content.decode("utf-8-sig") if path.suffix == ".toml" else text_of(content)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        beside = [other.name for other in path.parent.glob("*.toml")] if isinstance(error, FileNotFoundError) else []
        raise InputError(f"{path}: cannot read the {what}: {reason}{closest(path.name, beside)}") from error


def parse_toml(text: str, origin: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        InputError: If it is not valid TOML, or names or values are nested deeply: the time that tomllib takes for a
            dotted name grows with the square of its parts.
    """
    unescaped = text.replace(r"\\", "").replace(r"\"", "")  # an expression for escapes would be quadratic
    if long := _LONG_NAME.search(unescaped):
        raise InputError(f"{origin}: {long[0][:40]}...: a name of more than {_MOST_PARTS} parts with dots between them")
    try:
        tables = tomllib.loads(text)
        _refuse_large_numbers(tables, origin)
        return tables
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{origin}: not valid TOML: {error}") from error
    except ValueError as error:  # Python's, of a number of more than 4,300 digits
        raise InputError(f"{origin}: a whole number has more digits than can be read; {_LARGEST_NUMBERS}") from error
    except RecursionError as error:
        raise InputError(f"{origin}: brackets are nested too deeply") from error


def _refuse_large_numbers(value: Any, place: str) -> None:
    """Refuse whole numbers that no message could repeat: Python writes none of more than 4,300 digits."""
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        raise InputError(f"{place}: a whole number of {value.bit_length():,} bits; {_LARGEST_NUMBERS}")
    for key, inner in value.items() if isinstance(value, dict) else ():
        _refuse_large_numbers(inner, f"{place}: {key[:_LONGEST_SHOWN]}")
    for inner in value if isinstance(value, list) else ():
        _refuse_large_numbers(inner, place)


def toml_text(tables: Mapping[str, Any]) -> str:
    """Tables of a program as the text of a file; arrays become lists, and None leaves a key out.

    Raises:
        InputError: For a key that is no text, or a value that TOML cannot hold.
    """
    import tomlkit  # files are read without it

    return tomlkit.dumps(_plain(tables, ""))


def toml_array(values: Iterable[str | float]) -> Any:
    """Texts and numbers as an array of a tomlkit document, in time that grows with their number.

    The conversion of tomlkit itself takes the square of it: 6 min for 20,000 numbers, which take 0.4 s here.
    """
    from tomlkit.items import Array, Trivia, Whitespace, item

    parts = [part for value in values for part in (Whitespace(", "), item(value))]
    return Array(parts[1:], Trivia())


def _plain(value: Any, key: str) -> Any:
    """A value with the types of TOML; see `toml_text`."""
    if isinstance(value, Mapping):
        for name in value:
            if not isinstance(name, str):
                raise InputError(f"{key or 'the study'}: the key {shown(name)} is no text")
        inside = {name: item for name, item in value.items() if item is not None}
        return {name: _plain(item, f"{key}.{name}" if key else name) for name, item in inside.items()}
    if isinstance(value, Path):
        return str(value)
    value = value.tolist() if hasattr(value, "tolist") else value  # of NumPy, xarray or pandas
    if isinstance(value, list | tuple | range):
        items = [_plain(item, key) for item in value]
        return items if any(isinstance(item, dict | list) for item in items) else toml_array(items)
    if not isinstance(value, str | bool | int | float):
        raise InputError(f"{key} = {shown(value)}: expected a number, a text or a list, not a {type(value).__name__}")
    return value


def tables_in(path: Path) -> set[str]:
    """Names of the tables of a TOML file, by which its kind is known; InputError if it cannot be read."""
    return set(parse_toml(read_text(path, "file"), str(path)))


def shown(value: object) -> str:
    """A value as a message repeats it: the beginning of a long one."""
    text = repr(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."

"""Annotations of a result: a name, an owner, tags and a note, in the file `about.toml` of its directory.

It is not part of the study: its changes affect no point and no hash. The command `annotate`, the service and its page
read and write the same file; reports print it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit

from tripod_doe.errors import InputError, StorageError, printable
from tripod_doe.files.atomic_files import replace_text
from tripod_doe.files.regular_files import read_regular
from tripod_doe.study.definition.toml_text import parse_toml

FILE = "about.toml"
"""File of a result directory."""

_MOST_TAGS = 20
_LONGEST = {"name": 200, "owner": 100, "tag": 60, "note": 20_000}  # characters
_LARGEST_FILE = 100_000  # bytes: the longest texts, of four bytes a character, and the keys


@dataclass(frozen=True)
class Annotation:
    """An annotation of a result; empty where nothing was written."""

    name: str = ""  # instead of the study's name; `customer/joint-7` puts it into the folder `customer`
    owner: str = ""
    tags: tuple[str, ...] = ()
    note: str = ""  # Markdown

    def __bool__(self) -> bool:
        """Whether anything is written."""
        return self != Annotation()


def read_annotation(directory: Path) -> Annotation:
    """Read the annotation of a directory; empty without a file.

    Raises:
        InputError: If the file cannot be read, with the key that is wrong.
    """
    path = directory / FILE
    try:
        content = parse_toml(read_regular(path, _LARGEST_FILE).decode(), "TOML")
    except FileNotFoundError:
        return Annotation()
    except (OSError, ValueError, InputError) as error:
        reason = str(error).removeprefix(f"{path}: ")
        raise InputError(f"{path}: cannot read this file: {reason}; repair it, or delete it") from error
    return annotated(Annotation(), content, str(path))


def annotated(before: Annotation, changes: dict[str, Any], place: str = "") -> Annotation:
    """An annotation with some of its values changed.

    Args:
        changes: New values of name, owner, tags and note.
        place: Where they come from, for messages.

    Raises:
        InputError: If a key is unknown, or a value is no text, too long or holds control characters.
    """
    where = f"{place}: " if place else ""
    for key, value in changes.items():
        if key not in asdict(before):
            raise InputError(f"{where}unknown key {key!r}; allowed: name, owner, tags, note")
        if key == "tags":
            _check_tags(where, value)
        else:
            _check_text(f"{where}{key}", value, _LONGEST[key], lines=key == "note")
        if key == "name" and value.strip() and not is_in_folders(value.split("/")):
            raise InputError(
                f"{where}name: {value[:60]!r}: parts between slashes are names of folders, not '', '.' or '..'"
            )
    plain: dict[str, Any] = {
        key: tuple(dict.fromkeys(tag.strip() for tag in value)) if key == "tags" else value.strip()
        for key, value in changes.items()
    }
    return replace(before, **plain)


def is_in_folders(parts: Sequence[str]) -> bool:
    """Whether the parts of a name, split at its slashes, are folders and a name within them."""
    return all(part.strip() not in ("", ".", "..") for part in parts)


def _check_tags(where: str, value: object) -> None:
    if not isinstance(value, Sequence) or isinstance(value, str) or not all(isinstance(tag, str) for tag in value):
        raise InputError(f"{where}tags: expected a list of texts")
    if len(value) > _MOST_TAGS:
        raise InputError(f"{where}tags: {len(value)} tags, at most {_MOST_TAGS}")
    for tag in value:
        if not tag.strip() or "," in tag:
            raise InputError(f"{where}tags: {tag[:60]!r}: a tag is not empty and has no comma")
        _check_text(f"{where}tags", tag, _LONGEST["tag"], lines=False)


def _check_text(where: str, value: object, longest: int, lines: bool) -> None:
    if not isinstance(value, str):
        raise InputError(f"{where}: expected text, not {type(value).__name__}")
    if len(value) > longest:
        raise InputError(f"{where}: {len(value):,} characters, at most {longest:,}")
    plain = value.replace("\r\n", "\n").replace("\t", " ") if lines else value
    if printable(plain) != plain or (not lines and "\n" in plain):
        raise InputError(f"{where}: control characters{'' if lines else ' and line ends'} are not allowed")


def write_annotation(directory: Path, annotation: Annotation) -> None:
    """Write the annotation of a directory; an empty annotation removes the file.

    Raises:
        InputError: If this is no directory.
        StorageError: If it cannot be written.
    """
    if not directory.is_dir():
        raise InputError(f"{directory}: no such result directory")
    path = directory / FILE
    if not annotation:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise StorageError(f"{path}: cannot remove this file: {error.strerror}") from error
        return
    table = tomlkit.document()
    for key, value in asdict(annotation).items():
        if value:
            table[key] = tomlkit.string(value, multiline="\n" in value) if isinstance(value, str) else list(value)
    replace_text(path, tomlkit.dumps(table))
    path.chmod(0o600 | directory.stat().st_mode & 0o044)  # readable like the directory, independent of a server's umask

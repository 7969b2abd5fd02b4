"""A TOML file of tables with its text and place, for errors that name file, table, key and value."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from pydantic import ValidationError

from tripod_doe.errors import InputError
from tripod_doe.study.definition.complaints import complaints
from tripod_doe.study.definition.study_file_schema import Table
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import parse_toml, read_text
from tripod_doe.study.expressions import Expression

F = TypeVar("F", bound=Table)
_HEADS = ("study", "workflow", "fit", "optimisation")
"""Tables that identify the kind of a file."""


@dataclass(frozen=True)
class TableFile(Generic[F]):
    """A file with its text and place."""

    file: F  # its tables
    text: str  # as written
    origin: str  # where it came from, for messages
    folder: StudyFolder  # where its files and functions are looked up

    def fail(self, where: str, error: InputError | str) -> InputError:
        """An error that names this file and the key; one of a kind stays of that kind."""
        place = f"{self.origin}: {where}" if where else self.origin
        return (error if isinstance(error, InputError) else InputError(error)).at(place)

    def check_condition(self, where: str, text: str | None, names: Collection[str]) -> None:
        """Refuse a condition that is not a valid expression of these names; None means no condition."""
        try:
            Expression(text or "0", names)
        except InputError as error:
            raise self.fail(where, error) from error


def read_table_file(path: str | Path, model: type[F], head: str, untrusted: bool) -> TableFile[F]:
    """Read a file and check its form.

    Args:
        model: All its tables.
        head: The table that identifies its kind.

    Raises:
        InputError: If it cannot be read, or a table, key or value in it is wrong.
    """
    path = Path(path)
    text, origin = read_text(path, f"{head} file"), str(path)
    raw = parse_toml(text, origin)
    if head not in raw:
        wanted = f"{'an' if head[0] in 'aeiou' else 'a'} {head}"
        kind = next((f"this is a {name} file, not {wanted}" for name in _HEADS if name in raw), "")
        raise InputError(f"{origin}: {kind or f'the file: table [{head}] is missing'}")
    try:
        file = model.model_validate(raw)
    except ValidationError as error:
        raise InputError("\n".join(f"{origin}: {line}" for line in complaints(error, model))) from error
    return TableFile(file, text, origin, StudyFolder.of(path, untrusted))

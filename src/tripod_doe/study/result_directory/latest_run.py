"""What the latest run of a directory stored of its end: a sentence on its search condition, and failed analyses."""

from contextlib import suppress
from pathlib import Path

from tripod_doe.errors import TripodDoeError, printable
from tripod_doe.files.checksum_list import listed_json
from tripod_doe.study.cube.file_checks import ANALYSES
from tripod_doe.study.journal import Journal, journal_path

FOUND = "found"
"""Note in the journal: the sentence on the points that meet the condition of the study."""

FAILED = f"{ANALYSES}/failed.json"
"""File of a result directory: for each analysis that failed, by name, the reason."""

_MOST_BYTES = 1_000_000
_LONGEST = 1_000  # characters of a sentence


def found_in(directory: Path) -> str:
    """The sentence of the latest run of a result directory; empty without one."""
    if journal_path(directory).is_file():
        with suppress(TripodDoeError), Journal(directory, read_only=True) as journal:
            return printable(journal.recall(FOUND) or "")[:_LONGEST]
    return ""


def failed_analyses(directory: Path) -> dict[str, str]:
    """The analyses of the latest run that failed, by name, with their reasons; empty where their file is damaged."""
    found = listed_json(directory / FAILED, _MOST_BYTES)
    reasons = found.items() if isinstance(found, dict) else ()
    return {printable(name): printable(str(reason))[:_LONGEST] for name, reason in reasons}

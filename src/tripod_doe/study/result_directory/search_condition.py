"""The search condition of a run: a sentence that its process stores with the results."""

from contextlib import suppress
from pathlib import Path

from tripod_doe.errors import TripodDoeError, printable
from tripod_doe.study.journal import Journal, journal_path

FOUND = "found"
"""Note in the journal: the sentence on the points that meet the condition of the study."""

_LONGEST = 1_000  # characters of a sentence


def found_in(directory: Path) -> str:
    """The sentence of the latest run of a result directory; empty without one."""
    if journal_path(directory).is_file():
        with suppress(TripodDoeError), Journal(directory, read_only=True) as journal:
            return printable(journal.recall(FOUND) or "")[:_LONGEST]
    return ""

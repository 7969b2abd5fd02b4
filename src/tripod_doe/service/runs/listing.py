"""The list of runs, filtered, sorted and split into pages."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

from tripod_doe.service.runs.run_table import Run
from tripod_doe.study.result_directory.annotation import is_in_folders

T = TypeVar("T")

PAGE = 50
"""Runs on a page."""

Sort = Literal["newest", "oldest", "updated", "name", "state", "points", "cpu"]
"""Orders of the list."""

_KEYS: dict[str, tuple[Callable[[Run], Any], bool]] = {  # key, and whether the largest comes first
    "newest": (lambda run: run.created, True),
    "oldest": (lambda run: run.created, False),
    "updated": (lambda run: run.updated, True),
    "name": (lambda run: run.shown_name.casefold(), False),
    "state": (lambda run: run.state.value, False),
    "points": (lambda run: run.counts.total, True),
    "cpu": (lambda run: run.counts.cpu_seconds, True),
}
SORTS: tuple[str, ...] = get_args(Sort)
"""Names of the orders."""


@dataclass(frozen=True)
class RunFilter:
    """Filters of the list of runs; empty ones let every run pass."""

    text: str = ""  # all its words occur in name, question, note, owner, tags, factors, models or id
    tags: tuple[str, ...] = ()  # the run has all these tags
    states: tuple[str, ...] = ()  # the run has one of these states
    folder: str = ""  # its name begins with this folder: `customer` holds `customer/joint-7`
    # since, until: first and last time of submission, as `run_table.stamp` writes them
    since: str = ""
    until: str = ""
    sort: str = "newest"

    def __bool__(self) -> bool:
        """Whether the filter can leave a run out."""
        return bool(self.text or self.tags or self.states or self.folder or self.since or self.until)

    def select(self, runs: Sequence[Run]) -> list[Run]:
        """The runs that pass, in the requested order."""
        words = self.text.casefold().split()
        key, reverse = _KEYS[self.sort]
        passed = (run for run in runs if self._passes(run, words)) if self else runs
        return sorted(passed, key=key, reverse=reverse)

    def _passes(self, run: Run, words: Sequence[str]) -> bool:
        if self.states and run.state.value not in self.states:
            return False
        if self.tags and not set(self.tags) <= set(run.tags):
            return False
        if self.folder and not run.shown_name.startswith(f"{self.folder.rstrip('/')}/"):
            return False
        if (self.since and run.created < self.since) or (self.until and run.created > self.until):
            return False
        return all(word in run.searched_text for word in words)


def page_of(runs: Sequence[T], page: int) -> list[T]:
    """The runs, or their stand-ins, on one page; pages count from 1."""
    return list(runs[(page - 1) * PAGE : page * PAGE])


def page_count(runs: Sequence[object]) -> int:
    """Number of pages of a list, at least one."""
    return max(1, -(-len(runs) // PAGE))


def tags_of(runs: Sequence[Run]) -> list[str]:
    """All tags, in alphabetical order."""
    return sorted({tag for run in runs for tag in run.tags})


def folders_of(runs: Sequence[Run]) -> list[str]:
    """All folders in the names of runs, including nested folders; a study's name may hold slashes that mean others."""
    names = [run.shown_name.split("/") for run in runs]
    parts = [name[:-1] for name in names if is_in_folders(name)]
    return sorted({"/".join(part[: depth + 1]) for part in parts for depth in range(len(part))})


def short_ids(runs: Sequence[Run]) -> dict[str, str]:
    """For runs with equal names, the first six characters of their ids, by id."""
    names = Counter(run.shown_name for run in runs)
    return {run.id: run.id[:6] for run in runs if names[run.shown_name] > 1}


def names_of(runs: Sequence[Run]) -> dict[str, str]:
    """Names for lists to choose from, by id: equal ones are followed by the first characters of the id."""
    short = short_ids(runs)
    return {run.id: f"{run.shown_name} ({short[run.id]})" if run.id in short else run.shown_name for run in runs}

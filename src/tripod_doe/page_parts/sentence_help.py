"""The entry of `sentence_help.toml` that explains a sentence of a page: its meaning, and its computation."""

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files


@dataclass(frozen=True)
class Reading:
    """The meaning of a kind of sentence."""

    key: str  # anchor on pages and in the guide
    group: str  # kind of page
    title: str
    meaning: str
    computed: str
    patterns: tuple[re.Pattern[str], ...]


@cache
def readings() -> tuple[Reading, ...]:
    """All entries, in the order in which they are tried."""
    tables = tomllib.loads(files("tripod_doe.page_parts").joinpath("sentence_help.toml").read_text(encoding="utf-8"))
    return tuple(
        Reading(
            key,
            table["group"],
            table["title"],
            table["meaning"],
            table["computed"],
            tuple(re.compile(pattern) for pattern in table["match"]),
        )
        for key, table in tables.items()
    )


def reading_of(sentence: str) -> Reading | None:
    """The entry that explains a sentence; None for a sentence that a user wrote."""
    return next((each for each in readings() if any(pattern.search(sentence) for pattern in each.patterns)), None)


def guide_entries() -> str:
    """All entries as Markdown, by kind of page: a part of docs/reference/reports.md."""
    lines, group = [], ""
    for each in readings():
        if each.group != group:
            group = each.group
            lines.append(f"### {group}\n")
        lines.append(f"#### {each.title}\n\n{each.meaning}\n\n*Computed:* {each.computed}\n")
    return "\n".join(lines)

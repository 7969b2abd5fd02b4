"""The top of a page: the answer in at most three sentences, and the picture that shows it."""

import re
from collections.abc import Sequence
from typing import TypeVar

_MOST = 3
_NEXT_SENTENCE = re.compile(r"(?<=[.!?])(?<!Fig\.)(?<!Figs\.) (?=[A-Z0-9])")

Picture = TypeVar("Picture")


def answer_first(findings: Sequence[str]) -> tuple[list[str], list[str]]:
    """The first three sentences, and all others.

    Args:
        findings: The most important first; a finding may be several sentences long.

    Returns:
        answer, more : list of str
    """
    answer: list[str] = []
    for position, finding in enumerate(findings):
        sentences = _NEXT_SENTENCE.split(finding)
        room = _MOST - len(answer)
        answer += sentences[:room]
        if len(sentences) >= room:
            rest = " ".join(sentences[room:])
            return answer, [*([rest] if rest else []), *findings[position + 1 :]]
    return answer, []


def beyond(findings: Sequence[str], answer: Sequence[str]) -> list[str]:
    """Findings without the sentences of an answer, so that a page repeats nothing."""
    left = ([sentence for sentence in _NEXT_SENTENCE.split(finding) if sentence not in answer] for finding in findings)
    return [" ".join(sentences) for sentences in left if sentences]


def picture_first(groups: Sequence[Sequence[Picture]]) -> Picture | None:
    """The first picture of the first group with pictures; None if there is none."""
    return next((group[0] for group in groups if group), None)

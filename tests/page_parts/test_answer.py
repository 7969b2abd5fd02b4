"""The answer of a page, and what is left for the rest of it."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.page_parts.answer import answer_first, beyond


@pytest.mark.parametrize("seed", range(20))
def test_a_page_says_nothing_twice_and_loses_nothing(seed):
    """Invariance: sentences of the answer and those beyond it are together all, each once. Regression: "20 of 20"."""
    random = np.random.default_rng(seed)
    sentences = [f"Sentence {at} says {value:.2f} N." for at, value in enumerate(random.uniform(size=9))]
    cuts = np.unique(random.integers(1, 9, 3))
    findings = [" ".join(part) for part in np.split(np.array(sentences), cuts)]
    answer, _ = answer_first(findings)
    rest = beyond(findings, answer)
    assert " ".join([*answer, *rest]) == " ".join(sentences)

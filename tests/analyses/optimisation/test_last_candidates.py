"""How much the last candidates of a search improved the best one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tripod_doe.analyses.optimisation import sentences


@pytest.mark.parametrize(
    ("course", "text"),
    [
        ([5.0, 4.0, 2.0], "the last one changed the best value by"),
        ([5.0, 4.0, 4.0], "the last one is not better than earlier ones,"),
        ([np.nan, np.nan, 4.0], "the first feasible one is the last one,"),
        ([9.0, 8, 7, 6, 5, 4, 3, 2], "the last 2 changed the best value by"),
        ([9.0, 8, 7, 6, 5, 4, 4, 4], "none of the last 2 is better than earlier ones,"),
    ],
)
def test_one_candidate_is_not_counted(course, text, monkeypatch):
    """Regression: "the last 1 changed the best value"."""
    monkeypatch.setattr(sentences, "objective_is_level", lambda problem, at: False)
    assert sentences._last_gain(SimpleNamespace(), np.array(course)).startswith(text)

"""Candidates that a better model judges, batch after batch."""

import pytest

from tripod_doe.analyses.optimisation.confirmation import confirmation_batches


@pytest.mark.parametrize(
    ("confirmed", "objectives", "batches"),
    [(12, 1, [4, 2, 2, 2, 2]), (4, 1, [3, 1]), (2, 2, [1, 1]), (1, 1, [1]), (5, 2, [2, 1, 1, 1])],
)
def test_one_batch_at_least_follows_the_first(confirmed, objectives, batches):
    """Regression: with four of one objective none did, and half of the evaluations were not used."""
    assert confirmation_batches(confirmed, objectives) == batches

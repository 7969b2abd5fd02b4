"""Failures as people read them: the commonest reasons with their counts, and only advice that can help."""

from __future__ import annotations

import pytest

from tripod_doe.errors import speaking_of_options
from tripod_doe.model_interface import Outcome
from tripod_doe.study.failure_summary import common_failures, failure_lines


def test_reasons_that_differ_in_numbers_only_are_one():
    ends = [(Outcome.DIVERGED, f"no balance at {angle} deg") for angle in (3.5, 17, -4e-3)]
    ends += [(Outcome.FINISHED, "a note"), (Outcome.JAMMED, "no room"), (Outcome.NOT_RUN, "")]
    result = common_failures(ends, {Outcome.FINISHED, Outcome.NOT_RUN})
    assert [str(failure) for failure in result] == [
        "3 points ended as diverged: no balance at 3.5 deg",
        "1 point ended as jammed: no room",
    ]


def test_the_commonest_come_first_and_the_rest_is_counted():
    ends = [(Outcome.JAMMED, word * 3) for word, count in zip("abcde", range(1, 6), strict=True) for _ in range(count)]
    lines = failure_lines(common_failures(ends))
    assert lines[0] == "5 points ended as jammed: eee"
    assert lines[3] == "3 more failed for other reasons: see outcome_detail in the cube"


@pytest.mark.parametrize(
    ("outcome", "advice"),
    [
        (Outcome.JAMMED, ""),
        (Outcome.OUT_OF_RANGE, ""),
        (Outcome.NOT_APPLICABLE, ""),
        (Outcome.WORKER_LOST, "--retry-failed"),
        (Outcome.ERROR, "--retry-failed"),
        (Outcome.INACCURATE, "smaller-step"),
        (Outcome.EVALUATION_LIMIT, "evaluation_budget"),
    ],
)
def test_a_retry_is_advised_only_where_it_can_end_otherwise(outcome, advice):
    """Regression: --retry-failed was suggested for parts that do not fit."""
    with speaking_of_options():
        _, *message = failure_lines(common_failures([(outcome, "")]))
    assert bool(message) == bool(advice)
    assert all(advice in line for line in message)


def test_what_the_study_tries_itself_is_not_advised():
    failures = common_failures([(Outcome.INACCURATE, "")])
    assert len(failure_lines(failures)) == 2
    assert len(failure_lines(failures, retried=True)) == 1

"""Blocks of results: what fills a row, what a copy holds, and what does not mix."""

from __future__ import annotations

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.model_interface import WORK, BlockResult, Outcome, Retries

LABELS = np.array([1, 2])


def made(outcomes, **outputs):
    """A block whose every array counts its points from 1."""
    block = BlockResult.blank(len(outcomes))
    number = np.arange(1, len(outcomes) + 1)
    block.outcome[:] = outcomes
    block.detail[:] = [f"point {k}" for k in number]
    for name in WORK:
        getattr(block, name)[:] = number
    block.put("scalar", (), slice(None), number * 10.0)
    block.put("pair", ("side",), slice(None), np.outer(number, [1.0, -1.0]))
    block.coordinates["side"] = LABELS
    return block


def test_a_blank_block_has_run_nothing():
    block = BlockResult.blank(2, Outcome.WORKER_LOST, "gone")
    assert block.outcome.tolist() == [Outcome.WORKER_LOST] * 2
    assert block.detail == ["gone"] * 2
    assert all(getattr(block, name).tolist() == [0, 0] for name in WORK)
    assert (block.outputs, block.coordinates, block.retries) == ({}, {}, None)


def test_outputs_are_filled_only_where_points_finished():
    block = BlockResult.blank(4)
    block.fill(np.array([3, 1]), made([Outcome.FINISHED, Outcome.DIVERGED]))
    assert block.outcome.tolist() == [Outcome.NOT_RUN, Outcome.DIVERGED, Outcome.NOT_RUN, Outcome.FINISHED]
    assert block.detail == ["", "point 2", "", "point 1"]
    assert all(getattr(block, name).tolist() == [0, 2, 0, 1] for name in WORK)
    assert block.outputs["scalar"].data.tolist() == pytest.approx([np.nan, np.nan, np.nan, 10], nan_ok=True)
    assert block.outputs["pair"].data[3].tolist() == [1, -1]
    assert np.isnan(block.outputs["pair"].data[:3]).all()
    assert block.coordinates["side"] is LABELS


def test_an_output_that_no_point_gave_is_there():
    block = BlockResult.blank(2)
    block.fill(np.array([0]), made([Outcome.JAMMED]))
    assert block.outputs["pair"].data.shape == (2, 2)
    assert np.isnan(block.outputs["pair"].data).all()


def test_a_part_is_a_copy_in_the_order_of_its_rows():
    whole = made([Outcome.FINISHED] * 3)
    whole.coordinates["other"] = LABELS
    part = whole.take(np.array([2, 0]), keep=["pair"])
    assert part.detail == ["point 3", "point 1"]
    assert all(getattr(part, name).tolist() == [3, 1] for name in WORK)
    assert list(part.outputs) == ["pair"]
    assert part.outputs["pair"].data.tolist() == [[3, -3], [1, -1]]
    assert list(part.coordinates) == ["side"]
    part.outputs["pair"].data[:] = 0
    assert whole.outputs["pair"].data[0].tolist() == [1, -1]


def test_a_part_takes_its_retries_along():
    number = np.arange(2, dtype=np.int8)
    block = BlockResult.blank(2)
    retried = BlockResult(
        outcome=block.outcome,
        detail=block.detail,
        retries=Retries(number, number, ["a", "b"], {"step_s": number * 1.0}),
        **{name: getattr(block, name) for name in WORK},
    )
    part = retried.take(np.array([1])).retries
    assert (part.attempt.tolist(), part.first_outcome.tolist(), part.first_detail) == ([1], [1], ["b"])
    assert part.used["step_s"].tolist() == [1.0]


def test_values_of_different_shapes_do_not_mix():
    block = made([Outcome.FINISHED])
    with pytest.raises(InputError, match=r"pair: points have different shapes \(2,\) and \(3,\)"):
        block.put("pair", ("side",), 0, np.zeros(3))


@pytest.mark.parametrize("rows", [1, np.array([1]), slice(1, 2)])
def test_an_end_is_noted_for_its_rows_alone(rows):
    block = BlockResult.blank(3)
    block.end(rows, Outcome.ERROR, "bad")
    assert block.outcome.tolist() == [Outcome.NOT_RUN, Outcome.ERROR, Outcome.NOT_RUN]
    assert block.detail == ["", "bad", ""]

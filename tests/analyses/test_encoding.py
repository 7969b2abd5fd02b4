"""Encoding of factors: exact scales, one column per word but the first, and places that stay in the unit cube."""

from __future__ import annotations

import numpy as np

from tripod_doe.analyses.encoding import Input, as_numbers, encoded, in_unit_cube, inputs_of

COLUMNS = {"angle": np.array([4.0, 9.0, 14.0]), "model": np.array(["b", "a", "c"]), "held": np.array([2, 2, 2])}


def test_numbers_go_from_minus_1_to_1_and_words_become_indicators():
    inputs = inputs_of(COLUMNS)
    assert inputs == [Input("angle", 4, 14), Input("model", word="b"), Input("model", word="c"), Input("held", 2, 2)]
    assert encoded(COLUMNS, inputs).tolist() == [[-1, 1, 0, 0], [0, 0, 0, 0], [1, 0, 1, 0]]


def test_the_unit_cube_has_a_coordinate_for_every_word():
    assert in_unit_cube(COLUMNS, COLUMNS).tolist() == [[0, 0, 1, 0, 0], [0.5, 1, 0, 0, 0], [1, 0, 0, 1, 0]]
    beyond = {"angle": np.array([19.0]), "model": np.array(["d"]), "held": np.array([2])}
    assert in_unit_cube(beyond, COLUMNS).tolist() == [[1.5, 0, 0, 0, 0]]


def test_words_as_numbers_follow_the_alphabet():
    assert as_numbers(COLUMNS["model"]).tolist() == [1, 0, 2]
    assert as_numbers(COLUMNS["held"]).tolist() == [2, 2, 2]

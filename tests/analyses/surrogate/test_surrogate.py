"""A surrogate predicts points that it has not seen, and says how well."""

from __future__ import annotations

import numpy as np
import pytest
from published import cube_of

from tripod_doe.analyses.surrogate.sentences import find_in_surrogate
from tripod_doe.analyses.surrogate.surrogate import SurrogateSettings, surrogate
from tripod_doe.analyses.surrogate.what_if import read_what_if
from tripod_doe.errors import InputError

SETTINGS = SurrogateSettings(outputs=["y"])


def outputs(x):
    noise = np.random.default_rng(0).normal(0, 0.1, len(x))
    return np.stack([1 + x[:, 0] + 2 * x[:, 1] * x[:, 2], np.sin(8 * x[:, 0]) + x[:, 1], noise, 0 * x[:, 0]], axis=1)


@pytest.fixture(scope="module")
def learnt():
    return surrogate(cube_of('kind = "latin-hypercube"\nsamples = 80\nseed = 1', outputs), SETTINGS)


@pytest.mark.slow
def test_what_can_be_learnt_is_learnt(learnt):
    """Exact: a polynomial without error; a wave within 2 % of its size; of noise nothing, so its error is its size."""
    error = learnt["error_rms"].values
    assert error[0] < 1e-3
    assert error[1] < 0.02
    assert error[2] == pytest.approx(0.1, rel=0.3)
    assert np.isnan(error[3])
    assert learnt["predicted_part"].values[:2] == pytest.approx([1, 1], abs=1e-3)
    assert learnt["chosen"].values[3] == -1
    assert "Surrogate of y" in find_in_surrogate(learnt.isel(k=0), "s")[0]


@pytest.mark.slow
def test_components_have_the_labels_of_their_output():
    """Regression: "y 1" was the second label of k, whatever it is."""
    labelled = cube_of('kind = "latin-hypercube"\nsamples = 60\nseed = 1', outputs).assign_coords(k=[10, 20, 30, 40])
    components = read_what_if(surrogate(labelled, SETTINGS), "s").components
    assert [each.label for each in components] == ["y (k 10)", "y (k 20)", "y (k 30)"]


def test_few_points_are_refused():
    with pytest.raises(InputError, match="at least 10 different points, 8 finished"):
        surrogate(cube_of('kind = "latin-hypercube"\nsamples = 8', lambda x: x[:, 0]), SETTINGS)


def test_a_place_is_unseen_or_seen_as_a_whole():
    """Regression: with factors of levels the same place stood in both parts, and 96 % of noise was called predicted."""

    def noise_of_cell(x):
        cell = (5.999 * x[:, :2]).astype(int) @ [6, 1]
        return np.random.default_rng(1).normal(size=36)[cell]

    cube = cube_of('kind = "latin-hypercube"\nsamples = 150\nseed = 1', noise_of_cell, width=2)
    cube = cube.assign_coords({name: np.floor(5.999 * cube[name]) for name in ("joint_angle_deg", "torque_n_m")})
    assert float(surrogate(cube, SETTINGS)["predicted_part"]) < 0.2


@pytest.mark.parametrize(
    ("constraint", "sampled"), [("", True), ('constraints = ["torque_n_m < joint_angle_deg"]', False)]
)
def test_chances_are_drawn_for_independent_factors_only(constraint, sampled):
    """Regression: quantiles were those of factors without their constraint."""
    cube = cube_of(f'kind = "latin-hypercube"\nsamples = 60\nseed = 1\n{constraint}', lambda x: x[:, 0] - x[:, 1])
    assert read_what_if(surrogate(cube, SETTINGS), "s").sampled is sampled

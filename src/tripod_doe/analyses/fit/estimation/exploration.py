"""A first look at the whole range of the unknowns: minima of an interpolated model, from which the search begins.

Trunnions that may change places, and unknowns that make up for each other, give several minima. So the model is
computed at some places spread over the range and interpolated between them, and many descents on the interpolated model
say where to begin on the real one.
"""

import math

import numpy as np

from tripod_doe.analyses.fit.estimation.least_squares import Descent, Predict, Problem, distinct
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.array_types import ComplexArray, FloatArray

_FEWEST, _MOST = 32, 256  # places
_PER_TERM = 4  # places for each coefficient of a quadratic


def place_count(layout: Layout) -> int:
    """Number of the first places: the middle, and a power of two."""
    width = len(layout.unknowns)
    terms = (width + 1) * (width + 2) // 2
    return 1 + int(2 ** math.ceil(math.log2(min(max(_PER_TERM * terms, _FEWEST), _MOST))))


def first_places(layout: Layout, seed: int) -> FloatArray:
    """Places of the unknowns at which the model is computed, the same in all records, shape (place, unknown)."""
    from scipy.stats import qmc

    width, count = len(layout.unknowns), place_count(layout) - 1
    middle = np.full((1, width), 0.5)
    return np.vstack([middle, qmc.Sobol(width, seed=seed).random(count)])


def interpolated(layout: Layout, places: FloatArray, answers: ComplexArray) -> Predict | None:
    """The model between the places where it was computed; None where too few have an answer for all records.

    Args:
        layout: The scalars.
        places, answers: Places of the unknowns (place, unknown), and the orders there (place, row).
    """
    from scipy.interpolate import RBFInterpolator

    whole = np.isfinite(answers).all(axis=1)
    width = places.shape[1]
    if whole.sum() < (width + 1) * (width + 2):
        return None
    parts = np.hstack([answers[whole].real, answers[whole].imag])
    model = RBFInterpolator(places[whole], parts, kernel="cubic", degree=2)
    records = layout.index.shape[1]
    per_record = answers.shape[1] // records
    record = np.repeat(np.arange(records), per_record)
    shared = all(unknown.per == "all" for unknown in layout.unknowns)

    def predict(trials: FloatArray) -> ComplexArray:
        if shared:
            real, imaginary = np.split(model(trials[:, layout.index[:, 0]]), 2, axis=1)
            return np.asarray(real + 1j * imaginary, complex)
        own = np.stack([trials[:, row] for row in layout.index], axis=-1)  # (trial, record, unknown)
        flat = model(own.reshape(-1, width)).reshape(len(trials), records, -1)
        real, imaginary = np.split(flat, 2, axis=2)
        rows = np.arange(record.size)
        return np.asarray((real + 1j * imaginary)[:, record, rows], complex)

    return predict


def explore(problems: list[Problem], many: int, wanted: int, seed: int) -> list[Descent]:
    """Minima of an interpolated model: of some problems (by loss, and by the sign of the force) in turn.

    Args:
        many, wanted: Descents that are made, and minima that are returned of each problem.
    """
    each = [problem.minima(many, seed)[:wanted] for problem in problems]
    mixed = [descents[at] for at in range(wanted) for descents in each if at < len(descents)]
    kept = [id(one) for one in distinct(mixed)]
    return [one for one in mixed if id(one) in kept]

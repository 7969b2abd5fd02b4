"""Method studies of known errors and prices, for tests of their analysis and their charts."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.model_interface import Outcome

TRUTH = 100.0
ROLLER = '[study]\nname = "r"\nscene = "roller-in-groove"\n'
JOINT = '[study]\nname = "j"\n'


def cube_of(rows, study=ROLLER, variable="axial_force_n"):
    """A method study from rows (model, method, step, tolerance, relative error, price, outcome); half a second each."""
    columns = list(zip(*rows, strict=True))
    errors, outcome = np.array(columns[4]), np.array(columns[6])
    answers = np.where(outcome == Outcome.FINISHED, TRUTH * (1 + errors), np.nan)
    coords = {
        name: ("point", np.array(column, kind))
        for name, column, kind in zip(
            ("model", "method", "step_s", "relative_tolerance"), columns, (object, object, float, float), strict=False
        )
    }
    dims, data = ("point",), answers
    if variable == "thrust_amplitude":
        dims, data = ("point", "order"), np.repeat(answers[:, None], 4, axis=1)
        coords["order"] = ("order", np.arange(4))
        # a run with neither step nor tolerance is one by accuracy: here that of the default
        alone = np.isnan(coords["step_s"][1]) & np.isnan(coords["relative_tolerance"][1])
        coords["accuracy"] = ("point", np.where(alone, 0.02, np.nan))
    else:
        coords.pop("model")
    return xr.Dataset(
        {
            variable: (dims, data),
            "outcome": ("point", outcome.astype(np.int8)),
            "outcome_detail": ("point", np.where(outcome == Outcome.FINISHED, "", "it chatters").astype(object)),
            "cpu_seconds": ("point", 0.5 * np.array(columns[5])),
            "simulated_seconds": ("point", np.full(len(rows), 0.5)),
            "steps": ("point", np.ones(len(rows))),
            "force_evaluations": ("point", np.ones(len(rows))),
            "solves": ("point", np.ones(len(rows))),
        },
        coords=coords,
        attrs={"study": study, "fixed_parameters": "{}"},
    )


def fixed(method, steps, error, price, model="", outcome=Outcome.FINISHED):
    return [(model, method, h, np.nan, error(h), price(h), outcome) for h in steps]


def adaptive(method, tolerances, error, price, model="", outcome=Outcome.FINISHED):
    return [(model, method, np.nan, t, error(t), price(t), outcome) for t in tolerances]


def by_accuracy(error, price, model):
    return [(model, "adaptive-euler", np.nan, np.nan, error, price, Outcome.FINISHED)]


STEPS, FINE = (1e-2, 1e-3, 1e-4, 1e-8), (1e-2, 1e-3, 1e-4, 1e-7)
FIRST = fixed("implicit-euler", STEPS, lambda h: 10 * h, lambda h: 1e-3 / h)
SECOND = fixed("bdf2", FINE, lambda h: 1e4 * h**2, lambda h: 2e-3 / h)
EXACT = adaptive("rosenbrock", (1e-1, 1e-9), lambda t: t, lambda t: 50 / t**0.1)

"""The surrogate of the main outputs that a page can ask for other values of the factors.

Outputs are learned as they are, orders as the cosine and sine parts of their waves, which are smooth where amplitude
and phase are not. The errors at unseen points go with it, so that a page can draw bands around its answers.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.encoding import Input, encoded, inputs_of, is_numeric
from tripod_doe.analyses.outputs import OutputTable
from tripod_doe.analyses.sample import SAMPLED_DESIGNS, Sample
from tripod_doe.analyses.surrogate.learner import Surrogates, learn
from tripod_doe.array_types import FloatArray, IntArray

ATTRIBUTE = "what_if"
"""Attribute of a result that holds all that is no array."""

_SHOWN_POINTS = 2000  # computed points that a page can show and take bands from
_MOST_COMPONENTS = 26  # thirteen orders, two parts each
_AMPLITUDE, _PHASE = "thrust_amplitude", "thrust_phase_deg"


@dataclass(frozen=True)
class Component:
    """One number that is learned."""

    label: str  # of the output, or of the part of an order
    unit: str  # its unit
    order: int | None = None  # the order of which it is a part; None for other outputs
    wraps: bool = False  # whether it is a phase


@dataclass(frozen=True)
class WhatIf:
    """A surrogate with the points that it was fitted to."""

    inputs: list[Input]
    # for each factor its unit, range, mean and standard deviation over the computed points, or its words
    factors: dict[str, dict[str, Any]]
    components: list[Component]  # what it predicts; the cosine parts of orders come before their sine parts
    surrogates: Surrogates
    # places, values: inputs and outputs of the computed points that are shown, shape (computed, input or component)
    places: FloatArray
    values: FloatArray
    sampled: bool  # whether the computed points follow distributions of independent factors

    def encoded(self, **values: float | str) -> FloatArray:
        """One point as inputs, shape (1, input)."""
        return encoded({name: np.array([value]) for name, value in values.items()}, self.inputs)


def neighbours(count: int) -> int:
    """Number of nearest computed points from which a band is taken."""
    return min(max(12, count // 20), count - 1)


def what_if(sample: Sample, tables: list[OutputTable], cube: xr.Dataset, seed: int) -> xr.Dataset:
    """The surrogate of the main outputs as variables and one attribute of a result.

    Parameters
    ----------
    sample
        The points to learn from.
    tables
        The outputs that are asked for; with thrust_amplitude and its phases in the cube, the waves of the orders.
    cube
        The cube of the points.
    seed
        Of the division into folds.
    """
    inputs = inputs_of(sample.columns)
    places = encoded(sample.columns, inputs)
    components, values = _components(tables, cube, sample.rows)
    learned = learn(places, values, seed)
    shown = np.arange(min(_SHOWN_POINTS, len(places)))
    texts = {
        "inputs": [[each.factor, each.low, each.high, each.word] for each in inputs],
        "factors": {name: _range(name, sample, cube) for name in sample.columns},
        "sampled": sample.design.kind in SAMPLED_DESIGNS and not sample.design.correlation,
        "components": [[each.label, each.unit, each.order, each.wraps] for each in components],
    }
    data = {
        "exponents": (("what_if_term", "what_if_input"), learned.exponents),
        "coefficients": (("what_if_component", "what_if_term"), learned.coefficients),
        "centres": (("what_if_centre", "what_if_input"), learned.centres),
        "weights": (("what_if_component", "what_if_centre"), learned.weights),
        "lengths": (("what_if_component", "what_if_input"), learned.lengths),
        "errors": (("what_if_point", "what_if_component"), learned.errors[shown]),
        "places": (("what_if_point", "what_if_input"), places[shown]),
        "values": (("what_if_point", "what_if_component"), values[shown]),
    }
    variables = {
        f"what_if_{name}": (dims, array, {"long_name": f"surrogate of the page: {name}"})
        for name, (dims, array) in data.items()
    }
    return xr.Dataset(variables, attrs={ATTRIBUTE: json.dumps(texts)})


def read_what_if(result: xr.Dataset) -> WhatIf | None:
    """The surrogate in the result of an analysis; None where it has none."""
    if ATTRIBUTE not in result.attrs:
        return None
    texts = json.loads(result.attrs[ATTRIBUTE])
    names = ("exponents", "coefficients", "centres", "weights", "lengths", "errors")
    return WhatIf(
        [Input(*each) for each in texts["inputs"]],
        texts["factors"],
        [Component(*each) for each in texts["components"]],
        Surrogates(*(result[f"what_if_{name}"].values for name in names)),
        result["what_if_places"].values,
        result["what_if_values"].values,
        texts["sampled"],
    )


def _range(name: str, sample: Sample, cube: xr.Dataset) -> dict[str, Any]:
    """The values of a factor at the computed points: unit, range, mean and standard deviation, or words."""
    column = sample.columns[name]
    if not is_numeric(column):
        return {"unit": "", "words": sorted({str(word) for word in column})}
    numbers = column.astype(float)
    return {
        "unit": str(cube[name].attrs.get("units", "1")),
        "low": float(numbers.min()),
        "high": float(numbers.max()),
        "mean": float(numbers.mean()),
        "std": float(numbers.std()),
        "whole": bool((numbers % 1 == 0).all()),
    }


def _components(tables: list[OutputTable], cube: xr.Dataset, rows: IntArray) -> tuple[list[Component], FloatArray]:
    """What is learned, with its values, shape (point, component)."""
    if any(table.name == _AMPLITUDE for table in tables) and _PHASE in cube:
        amplitude, phase = (cube[name].isel(point=rows).values.astype(float) for name in (_AMPLITUDE, _PHASE))
        wave = amplitude * np.exp(1j * np.radians(phase))
        unit, orders = str(cube[_AMPLITUDE].attrs.get("units", "1")), cube["order"].values.tolist()
        parts = [("cosine", wave.real), ("sine", wave.imag)]
        components = [Component(f"{part} part of order {order}", unit, order) for part, _ in parts for order in orders]
        return components, np.concatenate([values for _, values in parts], axis=1)
    components, columns = [], []
    for table in tables:
        unit = str(table.variable.attrs.get("units", "1"))
        labels = table.keys[1:] if len(table.keys) - 1 == table.values.shape[1] else _numbered(table)
        for at in np.flatnonzero(table.varies):
            components.append(Component(labels[at], unit, wraps=table.wraps))
            columns.append(table.values[:, at] + table.centre[at])
    return components[:_MOST_COMPONENTS], np.stack(columns[:_MOST_COMPONENTS], axis=1)


def _numbered(table: OutputTable) -> list[str]:
    count = table.values.shape[1]
    return [table.name] if count == 1 else [f"{table.name} {at}" for at in range(count)]

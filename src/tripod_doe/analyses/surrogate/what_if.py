"""The surrogate of the main outputs that a page can ask for other values of the factors.

Outputs are learned as they are, orders as the cosine and sine parts of their waves, which are smooth where amplitude
and phase are not. The errors at unseen points go with it, so that a page can draw bands around its answers.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError, model_validator

from tripod_doe.analyses.encoding import Input, encoded, is_numeric
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.surrogate.gaussian_process import LEAST_SCALE, Surrogates, between_levels, learn, refuse_unlike
from tripod_doe.analyses.surrogate.zeros_and_symmetries import grown, known_structure
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import CubeError
from tripod_doe.model_interface import MIRRORED_BY, ZERO_AT
from tripod_doe.page_parts.words import place_text

ATTRIBUTE = "what_if"
"""Attribute of a result that holds all that is no array."""

_SHOWN_POINTS = 2000  # computed points that a page can show and take bands from
_MOST_COMPONENTS = 26  # besides the waves of the orders
_MOST_CHARACTERS = 1_000_000  # of the texts that are read
_LEARNED = ("exponents", "coefficients", "centres", "weights", "lengths", "errors")
_ROUNDING = 1e-9  # of a number that is scaled to its range and back
_AMPLITUDE, _PHASE = "thrust_amplitude", "thrust_phase_deg"
_FIRST = (3, 2)  # orders that everybody asks for


@dataclass(frozen=True)
class Component:
    """One number that is learned."""

    label: str  # of the output, or of the part of an order
    unit: str  # its unit
    order: int | None = None  # the order of which it is a part; None for other outputs
    wraps: bool = False  # whether it is a phase
    vanishes: bool = False  # whether it is zero where the envelope is, over which it is learned
    parity: int = 0  # 1 where it stays as it is when the mirrored factors change their sign, -1 where it does, too


@dataclass(frozen=True)
class WhatIf:
    """A surrogate with the points that it was fitted to."""

    inputs: list[Input]
    # for each factor its unit, range, mean, standard deviation and levels over the computed points, or its words
    factors: dict[str, dict[str, Any]]
    components: list[Component]  # what it predicts: the cosine parts of orders, their sine parts, then other outputs
    surrogates: Surrogates
    # places, values: inputs and outputs of the computed points that are shown, shape (computed, input or component)
    places: FloatArray
    values: FloatArray
    sampled: bool  # whether the computed points follow distributions of independent factors
    # factors whose zero makes components vanish, with the size at which the envelope is 1, and where its slope is less
    zeros: dict[str, tuple[float, float]]

    @property
    def vanishes(self) -> NDArray[np.bool_]:
        """Whether each component is zero where the envelope is zero, shape (component,)."""
        return np.array([each.vanishes for each in self.components])

    @property
    def envelope_parts(self) -> list[tuple[int, float, float, float]]:
        """For each zero its input, middle and half of its range over the size, and the part with less slope."""
        parts = []
        for at, each in enumerate(self.inputs):
            if each.factor in self.zeros and not each.sign:
                size, soft = self.zeros[each.factor]
                parts.append((at, (each.low + each.high) / 2 / size, (each.high - each.low) / 2 / size, soft))
        return parts

    @property
    def crossed(self) -> list[str]:
        """Factors of both signs whose zero makes components vanish."""
        return [name for name in self.zeros if self.factors[name]["low"] < 0 < self.factors[name]["high"]]

    def numbers(self, factor: str) -> FloatArray:
        """Values of a numeric factor at the computed points that are shown, shape (computed,)."""
        at, each = next((at, each) for at, each in enumerate(self.inputs) if each.factor == factor and not each.sign)
        return np.asarray((each.low + each.high) / 2 + self.places[:, at] * (each.high - each.low) / 2, float)

    @cached_property
    def reach(self) -> tuple[FloatArray, FloatArray, float]:
        """Mean of the computed points, inverse of their covariance, and the largest square of a distance to it.

        By Mahalanobis' distance, of n points a further one of their kind lies beyond all of them once in n + 1 times.
        """
        middle = self.places.mean(axis=0)
        inverse = np.linalg.pinv(np.atleast_2d(np.cov(self.places.T)))
        return middle, inverse, float(_squares(self.places - middle, inverse).max()) * (1 + _ROUNDING)

    def outside(self, places: FloatArray) -> NDArray[np.bool_]:
        """Places beyond all computed points, as corners of correlated factors are, where no errors are known."""
        middle, inverse, limit = self.reach
        return _squares(places - middle, inverse) > limit

    @property
    def waves(self) -> list[int]:
        """The orders whose waves are predicted; empty if there are none."""
        orders = [each.order for each in self.components if each.order is not None]
        return orders[: len(orders) // 2]

    def envelope(self, places: FloatArray) -> FloatArray:
        """A function of the inputs that is zero where components vanish, shape (point,)."""
        product = np.ones(len(places))
        for at, middle, half, soft in self.envelope_parts:
            size = np.abs(places[:, at] * half + middle)
            product = product * grown(np.where(size < _ROUNDING, 0.0, size), soft)
        return product

    def predict(self, places: FloatArray) -> FloatArray:
        """All components at some inputs, shape (point, component)."""
        answers = self.surrogates.predict(places)
        return np.where(self.vanishes, answers * self.envelope(places)[:, None], answers)

    def relative_errors(self) -> FloatArray:
        """Errors at unseen points, those of components that vanish over the envelope, shape (computed, component)."""
        envelope = np.maximum(self.envelope(self.places), LEAST_SCALE)[:, None]
        errors = self.surrogates.errors
        return np.where(self.vanishes, errors / envelope, errors)

    def encoded(self, **values: float | str) -> FloatArray:
        """One point as inputs, shape (1, input)."""
        return encoded({name: np.array([value]) for name, value in values.items()}, self.inputs)


def _squares(gaps: FloatArray, inverse: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pi,ij,pj->p", gaps, inverse, gaps))


_Number = Annotated[float, Field(ge=-1e100, le=1e100)]
_Size = Annotated[float, Field(ge=1e-100, le=1e100)]


class _Range(BaseModel, extra="forbid"):
    """A numeric factor."""

    unit: str
    low: _Number
    high: _Number
    mean: _Number
    std: _Number
    whole: bool
    levels: list[_Number] = []  # at which alone it may be asked; empty if it may be between them
    left_out: bool = False  # whether its inner levels were left out of the fit in turn


class _Words(BaseModel, extra="forbid"):
    """A factor of words."""

    unit: str
    words: Annotated[list[str], Field(min_length=1)]


class _Texts(BaseModel, extra="forbid"):
    """All of a surrogate that is no array."""

    inputs: Annotated[list[tuple[str, _Number, _Number, str | None, bool]], Field(min_length=1)]
    zeros: dict[str, tuple[_Size, _Number]] = {}
    factors: dict[str, _Range | _Words]
    sampled: bool
    components: Annotated[
        list[tuple[str, str, Annotated[int, Field(ge=0, le=100)] | None, bool, bool]], Field(min_length=1)
    ]

    @model_validator(mode="after")
    def _agree(self) -> Self:
        """Refuse inputs, zeros and orders that do not belong to the factors and to each other."""
        numeric = [name for name, each in self.factors.items() if isinstance(each, _Range)]
        words = {name: each.words for name, each in self.factors.items() if isinstance(each, _Words)}
        numbers = [factor for factor, _, _, word, sign in self.inputs if word is None and not sign]
        if sorted(numbers) != sorted(numeric) or not set(self.zeros) <= set(numeric):
            raise ValueError("inputs and factors do not agree")
        for factor, _, _, word, sign in self.inputs:
            if (word is not None and word not in words.get(factor, ())) or (sign and factor not in numeric):
                raise ValueError("inputs and factors do not agree")
        orders = [order for _, _, order, _, _ in self.components]
        half = sum(order is not None for order in orders) // 2
        if orders[:half] != orders[half : 2 * half] or None in orders[:half] or any(orders[2 * half :]):
            raise ValueError("the parts of the orders do not agree")
        return self


def neighbours(count: int) -> int:
    """Number of nearest computed points from which a band is taken."""
    return min(max(12, count // 20), count - 1)


def what_if(sample: Sample, tables: list[OutputTable], cube: xr.Dataset, seed: int) -> xr.Dataset:
    """The surrogate of the main outputs as variables and one attribute of a result.

    Args:
        tables: The outputs that are asked for; with thrust_amplitude and its phases in the cube, the waves of the
            orders.
    """
    components, values = _components(tables, cube, sample.rows)
    marks = [each.vanishes for each in components], [each.parity for each in components]
    known = known_structure(sample.columns, cube).fitted(sample.columns, values, marks, seed)
    inputs, places = known.inputs, known.places(sample.columns)
    learned = learn(places, values, seed, known=known.of(sample.columns, *marks))
    shown = np.arange(min(_SHOWN_POINTS, len(places)))
    texts = {
        "inputs": [[each.factor, each.low, each.high, each.word, each.sign] for each in inputs],
        "zeros": known.zeros,
        "factors": {name: _range(name, sample, cube) for name in sample.columns},
        "sampled": sample.design.kind in SAMPLED_DESIGNS and sample.independent,
        "components": [[c.label, c.unit, c.order, c.wraps, c.vanishes] for c in components],
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


def read_what_if(result: xr.Dataset, name: str) -> WhatIf | None:
    """The surrogate in the result of an analysis of this name; None if it has none.

    Raises:
        CubeError: If it is not as `what_if` gives it.
    """
    if ATTRIBUTE not in result.attrs:
        return None
    try:
        texts = _Texts.model_validate_json(str(result.attrs[ATTRIBUTE])[:_MOST_CHARACTERS])
        arrays = [result[f"what_if_{part}"].values for part in (*_LEARNED, "places", "values")]
        return _checked(texts, arrays)
    except ValidationError as error:
        where = ".".join(map(str, error.errors()[0]["loc"])) or "its texts"
        raise CubeError(f"analysis {name}: its surrogate is incomplete: {ATTRIBUTE}: {where}; make it again") from error
    except (KeyError, ValueError) as error:
        raise CubeError(f"analysis {name}: its surrogate is incomplete: {error.args[0]}; make it again") from error


def _checked(texts: _Texts, arrays: list[NDArray[Any]]) -> WhatIf:
    """A surrogate of texts and arrays; ValueError if they do not agree."""
    *learned, places, values = arrays
    inputs, components = [Input(*each) for each in texts.inputs], [Component(*each) for each in texts.components]
    surrogates = Surrogates(*learned)
    surrogates.refuse_strange(len(inputs), len(components), len(places))
    for array, width in ((places, len(inputs)), (values, len(components))):
        refuse_unlike("its points", array, (len(places), width))
    if not 1 < len(places) <= _SHOWN_POINTS:
        raise ValueError(f"{len(places)} points, 2 to {_SHOWN_POINTS} are shown")
    factors = {name: each.model_dump() for name, each in texts.factors.items()}
    return WhatIf(inputs, factors, components, surrogates, places, values, texts.sampled, texts.zeros)


def _range(name: str, sample: Sample, cube: xr.Dataset) -> dict[str, Any]:
    """The values of a factor at the computed points: unit, range, mean, standard deviation, levels; or words."""
    column = sample.columns[name]
    if not is_numeric(column):
        return {"unit": "", "words": sorted({str(word) for word in column})}
    numbers, between = column.astype(float), between_levels(column)
    return {
        "unit": str(cube[name].attrs.get("units", "1")),
        "low": float(numbers.min()),
        "high": float(numbers.max()),
        "mean": float(numbers.mean()),
        "std": float(numbers.std()),
        "whole": bool((numbers % 1 == 0).all()),
        "levels": np.unique(numbers).tolist() if between is False else [],
        "left_out": between is True,
    }


def _components(tables: list[OutputTable], cube: xr.Dataset, rows: IntArray) -> tuple[list[Component], FloatArray]:
    """Learned quantities with their values, shape (point, component)."""
    components: list[Component] = []
    columns: list[FloatArray] = []
    if any(table.name == _AMPLITUDE for table in tables) and _PHASE in cube:
        tables = [table for table in tables if table.name not in (_AMPLITUDE, _PHASE)]
        amplitude, phase = (cube[name].isel(point=rows).values.astype(float) for name in (_AMPLITUDE, _PHASE))
        wave = amplitude * np.exp(1j * np.radians(phase))
        unit, orders = str(cube[_AMPLITUDE].attrs.get("units", "1")), cube["order"].values.tolist()
        parts = [("cosine", wave.real), ("sine", wave.imag)]
        attrs = cube[_AMPLITUDE].attrs
        vanishes, mirrored = ZERO_AT in attrs, int(MIRRORED_BY in attrs)
        components = [
            Component(
                f"{part} part of order {order}", unit, order, False, vanishes, mirrored * (1 if order % 2 else -1)
            )
            for part, _ in parts
            for order in orders
        ]
        columns = [column for _, values in parts for column in values.T]
    most = len(components) + _MOST_COMPONENTS
    for table in sorted(tables, key=lambda table: table.values.shape[1]):  # single numbers, as of responses, first
        unit = str(table.variable.attrs.get("units", "1"))
        labels = table.keys[1:] if len(table.keys) - 1 == table.values.shape[1] else _placed(table)
        for at in sorted(np.flatnonzero(table.varies).tolist(), key=lambda at: _component_rank(table, at)):
            attrs = table.variable.attrs
            known = ZERO_AT in attrs, int(MIRRORED_BY in attrs)  # amplitudes stay as they are in a mirror
            components.append(Component(labels[at], unit, None, table.wraps, *known))
            columns.append(table.values[:, at] + table.centre[at])
    return components[:most], np.stack(columns[:most], axis=1)


def _component_rank(table: OutputTable, at: int) -> int:
    """Rank of a component among the components of its output: the most wanted orders come first."""
    order = int(table.variable["order"][at]) if table.variable.dims[1:] == ("order",) else None
    return _FIRST.index(order) - len(_FIRST) if order in _FIRST else at


def _placed(table: OutputTable) -> list[str]:
    """The components of an output by their labels: ``friction_power_w (mechanism groove_sliding)``."""
    dims, shape = table.variable.dims[1:], table.variable.shape[1:]
    places = [dict(zip(dims, place, strict=True)) for place in np.ndindex(shape)]
    labels = table.variable.to_dataset(name=table.name)
    return [table.name + place_text(labels, place) for place in places]

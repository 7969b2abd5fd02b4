"""The part of a report that answers "what if": a surrogate with its numbers, which the page evaluates by itself."""

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import Input
from tripod_doe.analyses.kinds import of_kind
from tripod_doe.analyses.surrogate.gaussian_process import LEAST_SCALE
from tripod_doe.analyses.surrogate.what_if import WhatIf, neighbours, read_what_if
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.number_text import interval, number, with_unit
from tripod_doe.page_parts.words import ORDINALS, listed, spoken, unit_text
from tripod_doe.phases import shorter_way

_COVERED = 0.95  # part of the unseen points that a band holds
_MOST = 6  # orders and outputs that one looks at together
_BESIDE = 3  # of them outputs, where there are orders
_SEEN = 0.01  # size of an order relative to the largest one below which it is not shown
_ALWAYS = (2, 3)  # orders that everybody asks for
_KNOWN = 0.5  # part of the variance; of one predicted worse, quantiles were off by up to 0.14 of their span
_DRAWS = 5000  # from which quantiles are taken
_STEPS = 41  # of a curve over a factor
_ANGLES = 120  # of a revolution


@dataclass(frozen=True)
class Quantity:
    """One number that the page shows."""

    # label, unit: in words
    label: str
    unit: str
    parts: tuple[int, ...]  # the component, or the cosine and sine part of an order, whose amplitude is shown
    # values, errors: at the computed points, and by how much the surrogate without them was too large, shape (point,);
    # errors over the envelope where the number vanishes with it
    values: FloatArray
    errors: FloatArray
    factor: float  # half width of the band, over the root mean square of the errors at the nearest points
    predicted: float  # part of its variance over the computed points that the surrogate without each of them predicts
    wraps: bool = False  # whether it is a phase
    vanishes: bool = False  # whether it is zero where the envelope is

    @property
    def known(self) -> bool:
        """Whether most of its variance is predicted, so that curves and quantiles mean something."""
        return self.predicted >= _KNOWN

    def of(self, components: FloatArray) -> FloatArray:
        """The number from predicted components, shape (point, component) -> (point,); a phase from -180 to 180 deg."""
        return self.placed(self.unwrapped(components))

    def placed(self, numbers: FloatArray) -> FloatArray:
        """Numbers as they are shown: amplitudes are not negative, phases lie between -180 and 180 deg."""
        if len(self.parts) == 2:
            return np.maximum(numbers, 0.0)
        return shorter_way(numbers) if self.wraps else numbers

    def unwrapped(self, components: FloatArray) -> FloatArray:
        """The number, a phase beyond 180 deg where others lie near."""
        chosen = components[:, self.parts]
        return chosen[:, 0] if len(self.parts) == 1 else np.hypot(chosen[:, 0], chosen[:, 1])


@dataclass(frozen=True)
class WhatIfPage:
    """Data of the page of one surrogate."""

    name: str  # name of the analysis
    surrogate: WhatIf  # the surrogate
    quantities: list[Quantity]  # what is shown

    @property
    def start(self) -> dict[str, float | str]:
        """The values of the factors with which the page begins: means, as one would set them, and the first words.

        Of a factor of both signs whose zero makes outputs zero, the median of the sign that more points have: at its
        mean nothing would depend on any other factor.
        """
        start: dict[str, float | str] = {}
        for name, factor in self.surrogate.factors.items():
            start[name] = factor["words"][0] if "words" in factor else _rounded(factor, self._typical(name))
        return start

    def _typical(self, name: str) -> float:
        factor = self.surrogate.factors[name]
        if name not in self.surrogate.crossed:
            return float(factor["mean"])
        numbers = self.surrogate.numbers(name)
        positive = (numbers > 0).sum() >= (numbers < 0).sum()
        return float(np.median(numbers[numbers > 0 if positive else numbers < 0]))

    @property
    def held(self) -> str:
        """Where the other factors are held, as a part of a sentence."""
        moved = []
        for name in self.surrogate.crossed:
            unit = unit_text(self.surrogate.factors[name]["unit"])
            moved.append(f"{spoken(name)} at {with_unit(number(float(self.start[name])), unit)}")
        aside = f", {listed(moved)} (outputs are zero at 0)" if moved else ""
        return f"the others in the middle of the points{aside}"

    @property
    def between_levels(self) -> list[str]:
        """What is known between the levels of factors, in words."""
        said, factors = [], self.surrogate.factors.items()
        if left_out := [spoken(name) for name, each in factors if each.get("left_out")]:
            said = [
                f"Each error is the largest without the point and without inner levels of {listed(left_out)}: an upper "
                "estimate for smooth outputs; a course that turns twice between two levels is not seen"
            ]
        if few := [spoken(name) for name, each in factors if len(each.get("levels", ())) > 1]:
            said += [
                f"Only the levels of {listed(few)} are shown, since they are too few to estimate errors between them"
            ]
        return said

    def at(self, **values: float | str) -> list[tuple[float, float]]:
        """Each quantity with half its band, NaN outside of the computed points, for some values of the factors."""
        place = self.surrogate.encoded(**values)
        components = self.surrogate.predict(place)
        near, envelope = _nearest(self.surrogate.places, place)[0], float(self.surrogate.envelope(place)[0])
        halves = [each.factor * float(np.sqrt((each.errors[near] ** 2).mean())) for each in self.quantities]
        if self.surrogate.outside(place)[0]:
            halves = [0.0 if each.vanishes and envelope == 0 else math.nan for each in self.quantities]
        return [
            (float(each.of(components)[0]), half * envelope if each.vanishes else half)
            for each, half in zip(self.quantities, halves, strict=True)
        ]

    def along(self, factor: str) -> tuple[FloatArray, FloatArray]:
        """Values of a numeric factor, and each quantity over them with the others at the start, (value, quantity).

        NaN outside of the computed points.
        """
        values_of = self.surrogate.factors[factor]
        values = np.array(values_of["levels"] or np.linspace(values_of["low"], values_of["high"], _STEPS))
        places = np.concatenate([self.surrogate.encoded(**{**self.start, factor: value}) for value in values])
        components = self.surrogate.predict(places)
        course = np.stack([each.of(components) for each in self.quantities], axis=1)
        return values, np.where(self.surrogate.outside(places)[:, None], np.nan, course)

    def drawn(self) -> list[FloatArray]:
        """Each quantity at places drawn from the computed points, factor by factor, with errors drawn next to them."""
        from scipy.spatial import cKDTree  # slow to import: few pages have such a part

        random, places = np.random.default_rng(0), self.surrogate.places
        rows = {factor: random.choice(len(places), _DRAWS) for factor in self.surrogate.factors}
        drawn = np.stack([places[rows[each.factor], at] for at, each in enumerate(self.surrogate.inputs)], axis=1)
        components, envelope = self.surrogate.predict(drawn), self.surrogate.envelope(drawn)
        near = cKDTree(places).query(drawn)[1]  # errors are of one size only among neighbours
        signs = random.choice([-1.0, 1.0], _DRAWS)
        values = [
            each.unwrapped(components) + signs * each.errors[near] * (envelope if each.vanishes else 1.0)
            for each in self.quantities
        ]
        positive = [bool((each.values >= 0).all()) for each in self.quantities]  # as amplitudes are
        return [np.maximum(v, 0.0) if p else v for v, p in zip(values, positive, strict=True)]

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """The table on the page before a control is moved, and on paper."""
        answers = zip(self.quantities, self.at(**self.start), strict=True)
        return [(each.label, interval(value, half), each.unit) for each, (value, half) in answers]

    @property
    def settings(self) -> list[tuple[str, dict[str, Any]]]:
        """The factors in words, with their ranges."""
        return [
            (name, {**factor, "label": spoken(name), "unit": unit_text(factor["unit"]), "start": self.start[name]})
            for name, factor in self.surrogate.factors.items()
        ]

    @property
    def points(self) -> int:
        """Computed points behind it."""
        return len(self.surrogate.places)

    def payload(self) -> Markup:
        """All numbers as JSON: arrays as base64 of their bytes, in single precision if they are only displayed."""
        surrogate, waves = self.surrogate, self.surrogate.waves
        content: dict[str, Any] = {
            "inputs": [_input(each) for each in surrogate.inputs],
            "factors": dict(self.settings),
            "start": self.start,
            "components": len(surrogate.components),
            "zeros": surrogate.envelope_parts,
            "vanishes": surrogate.vanishes.tolist(),
            "neighbours": neighbours(self.points),
            "exponents": _bytes(surrogate.surrogates.exponents, np.int8),
            "quantities": [
                {
                    "label": each.label,
                    "unit": each.unit,
                    "parts": each.parts,
                    "factor": each.factor,
                    "wraps": each.wraps,
                    "vanishes": each.vanishes,
                    "largest": float(np.abs(each.values).max()),
                    "values": _bytes(each.values, np.float32),
                    "errors": _bytes(each.errors, np.float32),
                }
                for each in self.quantities
            ],
        }
        for name in ("coefficients", "centres", "weights", "lengths"):
            content[name] = _bytes(getattr(surrogate.surrogates, name), np.float64)
        content["places"] = _bytes(surrogate.places, np.float64)
        middle, inverse, limit = surrogate.reach
        content["reach"] = {
            "middle": _bytes(middle, np.float64),
            "inverse": _bytes(inverse, np.float64),
            "limit": limit,
        }
        if waves:
            factor, largest = _wave_band(surrogate, waves)
            content["wave"] = {
                "orders": waves,
                "factor": factor,
                "largest": largest,
                "unit": self.quantities[0].unit,
                "values": _bytes(surrogate.values[:, : 2 * len(waves)], np.float32),
                "errors": _bytes(surrogate.relative_errors()[:, : 2 * len(waves)], np.float32),
            }
        return Markup(json.dumps(content).replace("<", "\\u003c"))  # no text opens a comment or ends the script


def what_if_pages(analyses: Mapping[str, xr.Dataset]) -> list[WhatIfPage]:
    """One for each surrogate that can be asked."""
    pages = []
    for name, result in of_kind(analyses, "surrogate").items():
        surrogate = read_what_if(result, name)
        if surrogate is not None:
            pages.append(WhatIfPage(name, surrogate, _quantities(surrogate)))
    return pages


def _input(each: Input) -> dict[str, Any]:
    """An input as the page's script reads it."""
    if each.word is not None:
        return {"factor": each.factor, "word": each.word}
    if each.sign:
        return {"factor": each.factor, "sign": True}
    return {"factor": each.factor, "middle": (each.low + each.high) / 2, "half": (each.high - each.low) / 2 or 1.0}


def _rounded(factor: Mapping[str, Any], value: float) -> float:
    """A value of a factor to about a hundredth of its range, or the nearest level."""
    if factor["levels"]:
        return float(min(factor["levels"], key=lambda level: abs(level - value)))
    span = factor["high"] - factor["low"]
    digits = 0 if factor["whole"] else 2 - math.floor(math.log10(span)) if span > 0 else 12
    return float(round(value, digits))


def _bytes(values: NDArray[Any], kind: type) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _quantities(surrogate: WhatIf) -> list[Quantity]:
    """The orders of the force that count, the largest over the computed points first, and the first outputs."""
    values, errors, components = surrogate.values, surrogate.surrogates.errors, surrogate.components
    orders = surrogate.waves
    count = len(orders)
    beside = list(enumerate(components))[2 * count :][: _BESIDE if orders else _MOST]
    choice: list[tuple[tuple[int, ...], str, str]] = []
    if orders:
        sizes = np.hypot(values[:, :count], values[:, count : 2 * count]).mean(axis=0)
        sizes[[order == 0 for order in orders]] = 0
        asked = [order in _ALWAYS for order in orders]
        large = np.flatnonzero((sizes >= _SEEN * sizes.max()) | asked)
        most = _MOST - len(beside)
        large = large[np.argsort(-sizes[large] - 1e9 * np.array(asked)[large], kind="stable")][:most]
        large = large[np.argsort(-sizes[large], kind="stable")]
        choice = [((int(at), int(at) + count), _order_label(orders[at]), components[at].unit) for at in large]
    choice += [((at,), each.label, each.unit) for at, each in beside]
    near = _nearest(surrogate.places, surrogate.places, itself=True)
    envelope = np.maximum(surrogate.envelope(surrogate.places), LEAST_SCALE)
    quantities = []
    for parts, label, unit in choice:
        plain = Quantity(label, unit_text(unit), parts, values[:, 0], values[:, 0], 1.0, 1.0)
        known = plain.unwrapped(values)
        error, first = plain.unwrapped(values + errors) - known, components[parts[0]]
        scatter = float(known.var())
        predicted = 1 - float((error**2).mean()) / scatter if scatter > 0 else 1.0
        if first.vanishes:
            error = error / envelope
        local = np.sqrt((error[near] ** 2).mean(axis=1))
        factor, wraps = _factor(np.abs(error), local), len(parts) == 1 and first.wraps
        quantities.append(
            Quantity(label, unit_text(unit), parts, known, error, factor, predicted, wraps, first.vanishes)
        )
    return quantities


def _order_label(order: int) -> str:
    return ORDINALS[order] if order < len(ORDINALS) else f"order {order}"


def _factor(error: FloatArray, local: FloatArray) -> float:
    """The factor on the local errors with which a band holds its part of the unseen points.

    Of n errors it is the one that a further error exceeds with the probability left: at the level (n + 1)/n of the
    part (split conformal prediction, Lei et al. 2018), since the plain quantile of 20 errors holds in 90 % only.
    """
    ratios = error[local > 0] / local[local > 0]
    share = min(_COVERED * (1 + 1 / max(ratios.size, 1)), 1.0)
    return float(np.quantile(ratios, share, method="higher")) if ratios.size else 1.0


def _nearest(places: FloatArray, at: FloatArray, itself: bool = False) -> IntArray:
    """The nearest computed points, shape (point, neighbour), without the point itself if `itself`."""
    from scipy.spatial.distance import cdist  # slow to import: few pages have such a part

    gaps = cdist(at, places, "sqeuclidean")
    order: IntArray = np.argsort(gaps, axis=1, kind="stable")
    return order[:, 1 : 1 + neighbours(len(places))] if itself else order[:, : neighbours(len(places))]


def _wave_band(surrogate: WhatIf, waves: list[int]) -> tuple[float, float]:
    """Factor of the band of the waveform, and the largest force of the computed points."""
    angles = np.arange(_ANGLES) * 2 * np.pi / _ANGLES * np.array(waves)[:, None]
    shapes = np.concatenate([np.cos(angles), -np.sin(angles)])
    values, error = (each[:, : 2 * len(waves)] @ shapes for each in (surrogate.values, surrogate.relative_errors()))
    near = _nearest(surrogate.places, surrogate.places, itself=True)
    local = np.stack([np.sqrt((error[rows] ** 2).mean(axis=0)) for rows in near])
    return _factor(np.abs(error).ravel(), local.ravel()), float(np.abs(values).max())

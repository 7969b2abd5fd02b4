"""Contributions of the mechanisms by every definition, as tables and sentences next to the paper's."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import compress
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.contribution.contribution import PAPER_POINT, PAPER_SHARES
from tripod_doe.analyses.kinds import of_kind
from tripod_doe.array_types import FloatArray
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.number_text import count_of, level_or_word, number, text_range, with_unit
from tripod_doe.page_parts.words import ORDINALS, factor_text, factor_unit, spoken, unit_text

DEFINITIONS = {
    "share_off": "switching off",
    "share_on": "on alone",
    "share_shapley": "Shapley value",
    "share_direct": "direct decomposition",
}
"""Definitions of a share by the variables that hold them."""

CHANGES = {"change_halved": "half of its friction", "change_off": "without it"}
"""Changes of one mechanism by the variables that hold them."""

ANSWERS = {
    "share_off": "loss without the mechanism",
    "share_on": "effect of the mechanism alone",
    "share_shapley": "mean over all sequences of switching on",
    "share_direct": "force of each mechanism with all on",
}
"""What each definition answers."""

_UNSURE = 0.05  # error of an amplitude, as a part of it, above which its shares are flagged
_ZERO = 1  # flag of a share: no amplitude beyond its error
_MANY = 4  # operating points from which on quartiles say more than the ends


@dataclass(frozen=True)
class Contribution:
    """The shares of one order, or of one output, at all operating points."""

    # analysis, key: name of the analysis, and of this part of it in file names
    analysis: str
    key: str
    what: str  # what is shared out, in words
    model: str  # the model of all points; empty where they have none, or several
    mechanisms: list[str]  # names of the mechanisms
    points: pd.DataFrame  # factors of the operating points, a row each; without columns where there is one point only
    units: dict[str, str]  # units of these factors as text
    labels: list[str]  # the operating points in words
    # percent by definition, each of shape (operating point, mechanism); NaN where not known
    shares: dict[str, FloatArray]
    changes: dict[str, FloatArray]  # percent of the amplitude by the variables that hold them, shapes as of shares
    # closure, none, interaction: percent: 100 less the sum of the shares by switching off, P(none) and the strongest
    # interaction
    closure: FloatArray
    none: FloatArray
    interaction: FloatArray
    pairs: list[str]  # the pairs with that interaction
    amplitude: str  # with all mechanisms on, as text with its unit
    amplitudes: list[str]  # at each operating point
    # at which operating points the amplitude is zero within its error, so that there are no shares
    zero: NDArray[np.bool_]
    # at which other operating points the error of the amplitude is so large that shares there say little
    uncertain: NDArray[np.bool_]
    paper: FloatArray | None  # the paper's shares of it, for each mechanism; None where it gives none
    # which operating points are the paper's joint at its joint angle, torque and speed
    like_paper: NDArray[np.bool_]
    missing: str  # why there are no shares at all; empty where there are some
    lost: list[str]  # at each operating point the combinations without a result; empty where all have one
    # smallest and largest Shapley value in percent, each of shape (operating point, mechanism); None without any
    shapley_bounds: tuple[FloatArray, FloatArray] | None

    @property
    def shared(self) -> NDArray[np.bool_]:
        """At which operating points some share is known."""
        known = [np.isfinite(values).any(axis=1) for values in self.shares.values()]
        return np.asarray(np.any(known, axis=0), bool)

    @property
    def many(self) -> bool:
        """Whether shares are stated as a distribution, for there are too many operating points."""
        return int(self.shared.sum()) >= _MANY

    @property
    def sides(self) -> dict[str, NDArray[np.bool_]]:
        """The operating points of drive and of coast, where there are both; else all of them without a name."""
        torque = self.points["torque_n_m"].to_numpy(float) if "torque_n_m" in self.points else np.ones(len(self.labels))
        sides = {"drive": torque > 0, "coast": torque < 0}
        known = all((rows & self.shared).any() for rows in sides.values())
        return sides if known else {"": np.ones(len(self.labels), bool)}

    def counted(self, values: FloatArray) -> NDArray[np.bool_]:
        """The operating points that a statement on shares or changes counts: those at which all of them are known."""
        known = np.asarray(np.isfinite(values).all(axis=1), bool)
        return known if known.any() else self.shared

    def knows(self, definition: str) -> bool:
        """Whether all shares by a definition are known where any share is."""
        return definition in self.shares and bool(np.isfinite(self.shares[definition][self.shared]).all())

    @property
    def fairest(self) -> str:
        """The definition that charts of many operating points show, and sentences without a direct decomposition."""
        return next((name for name in ("share_shapley", "share_off", "share_on") if self.knows(name)), "share_off")

    @property
    def counted_shares(self) -> FloatArray:
        """The fairest shares at the operating points that count, NaN at the others."""
        values = self.shares[self.fairest]
        return np.where(self.counted(values)[:, None], values, np.nan)

    @property
    def leading(self) -> str:
        """The definition that sentences use."""
        return "share_direct" if self.knows("share_direct") else self.fairest

    def differences(self) -> dict[str, float]:
        """Largest difference from the four printed shares at the paper's operating point, in percentage points."""
        if self.paper is None:
            return {}
        printed = [self.mechanisms.index(name) for name in PAPER_SHARES]
        there = {name: values[self.like_paper][:, printed] for name, values in self.shares.items()}
        known = {name: values for name, values in there.items() if np.isfinite(values).all()}
        return {name: float(np.abs(values - self.paper[printed]).max()) for name, values in known.items()}


def stated_over(part: Contribution, rows: NDArray[np.bool_], values: FloatArray) -> str:
    """Operating points of a statement in words, in the order of its values by `at_each`; empty if no more are there."""
    labels = [*compress(part.labels, rows)]
    if len(labels) >= _MANY:
        most = "up to " * bool(np.isnan(values).any())  # no point has all of them
        return f"median (and quartiles) over {most}{len(labels):,} operating points"
    return f"at {' / '.join(labels)}" if len(part.labels) > len(part.sides) else ""


def at_each(values: FloatArray, text: Callable[[FloatArray], str]) -> str:
    """Percent at each of a few operating points, one value if all texts are the same; quartiles if there are many."""
    each = [text(values[at : at + 1]) for at in range(values.size)]
    return " / ".join(each) if values.size < _MANY and len(set(each)) > 1 else text(values)


def contributions(analyses: Mapping[str, xr.Dataset]) -> list[Contribution]:
    """The third and the second order of every contribution analysis, or its output where that has no orders.

    Of models that a pilot chose, only the orders whose accuracy was asked for.
    """
    return [
        _contribution(name, result, order)
        for name, result in of_kind(analyses, "contribution").items()
        for order in ((3, 2) if "order" in result.dims else (None,))
        if order is None or str(order) in str(result.attrs.get("orders_asked", "2 3")).split()
        if order is None or order in result["order"].values
    ]


def _contribution(name: str, result: xr.Dataset, order: int | None) -> Contribution:
    points, what = _operating_points(result, order)
    factors = [str(c) for c in points.coords if points[c].dims == ("at",) and "source" in points[c].attrs]
    mechanisms = [str(each) for each in points["mechanism"].values]
    amplitude, unit = points["amplitude"].values, unit_text(str(points["amplitude"].attrs.get("units", "1")))
    zero = (points["share_off_flag"] == _ZERO).all("mechanism").values
    like_paper = np.full(amplitude.size, result.attrs.get("unlike_paper") == "{}")
    for factor in set(factors) & set(PAPER_POINT):
        like_paper &= points[factor].values == PAPER_POINT[factor]
    thrust = str(result.attrs.get("outputs", "")).startswith("thrust_")
    of_paper = order == 3 and thrust and set(mechanisms) == set(MECHANISMS) and like_paper.any()
    rest = 100 - sum(PAPER_SHARES.values())

    def by_point(keys: Iterable[str]) -> dict[str, FloatArray]:
        return {key: points[key].transpose("at", "mechanism").values for key in keys if key in points}

    bounds = by_point(["share_shapley_low", "share_shapley_high"])
    return Contribution(
        analysis=name,
        key=name if order is None else f"{name}-order-{order}",
        what=what,
        model=str(result.attrs.get("model", "")),
        mechanisms=mechanisms,
        points=pd.DataFrame({factor: points[factor].values for factor in factors}, index=range(amplitude.size)),
        units={factor: factor_unit(points, factor) for factor in factors},
        labels=_labels(points, factors),
        shares=by_point(DEFINITIONS),
        changes=by_point(CHANGES),
        closure=points["closure"].values,
        none=points["share_none"].values,
        **_interactions(points),
        amplitudes=[_amplitude(each[None], unit) for each in amplitude],
        amplitude=_amplitude(amplitude, unit),
        zero=zero,
        uncertain=~zero & (_error(points) > _UNSURE * amplitude),
        paper=np.array([PAPER_SHARES.get(each, rest) for each in mechanisms]) if of_paper else None,
        like_paper=like_paper,
        missing=_why_missing(points, zero),
        lost=_texts(points, "missing_combinations") or [""] * amplitude.size,
        shapley_bounds=(bounds["share_shapley_low"], bounds["share_shapley_high"]) if bounds else None,
    )


def _operating_points(result: xr.Dataset, order: int | None) -> tuple[xr.Dataset, str]:
    """The results of an order along a single dimension ``at`` of operating points, and what they are of."""
    dims = str(result.attrs.get("operating_dims", "")).split()
    points = result.stack(at=dims, create_index=False) if dims else result.expand_dims("at")
    points = points if order is None else points.sel(order=order)
    what = str(result.attrs.get("outputs", "")) if order is None else f"the {ORDINALS[order]}"
    for dim in points["share_off"].dims:
        if dim not in ("at", "mechanism"):  # the first groove stands for all
            what += f" ({dim} {points[dim].values[0]})" if dim in points.coords else f" ({dim} 1)"
            points = points.isel({dim: 0})
    return points, what


def _interactions(points: xr.Dataset) -> dict[str, Any]:
    """The strongest interaction of each operating point and its pair; NaN and no pairs where it is not known."""
    if "interaction" not in points:
        return {"interaction": np.full(points.sizes["at"], np.nan), "pairs": []}
    return {"interaction": points["strongest_interaction"].values, "pairs": _texts(points, "strongest_pair")}


def _texts(points: xr.Dataset, name: str) -> list[str]:
    return [str(text) for text in points[name].values] if name in points else []


def _error(points: xr.Dataset) -> FloatArray:
    """Numerical error of the amplitude; zero in results of versions that did not record it."""
    recorded = points["amplitude_error"] if "amplitude_error" in points else xr.zeros_like(points["amplitude"])
    return np.asarray(recorded.values)


def _why_missing(points: xr.Dataset, zero: NDArray[np.bool_]) -> str:
    if any(bool(points[key].notnull().any()) for key in DEFINITIONS if key in points):
        return ""
    if zero.all():
        return "its amplitude is zero within its error"
    lost = "points that they need did not finish or have no value"
    if not zero.any():
        return lost
    of = f"{count_of(int(zero.sum()), 'operating point')} of {zero.size:,}"
    return f"at {of} its amplitude is zero within its error, at the others {lost}"


def _labels(points: xr.Dataset, factors: list[str]) -> list[str]:
    """Operating points in words, by the factors that vary."""
    columns = []
    for name in factors:
        values, unit = points[name].values.tolist(), factor_unit(points, name)
        if len(set(values)) > 1:
            columns.append(
                [
                    with_unit(level_or_word(each), unit) if unit and each == each else factor_text(points, name, each)
                    for each in values
                ]
            )
    return [", ".join(parts) for parts in zip(*columns, strict=True)] if columns else [""] * points.sizes["at"]


def _amplitude(values: FloatArray, unit: str) -> str:
    values = values[np.isfinite(values)]
    if values.size == 0:
        return ""
    low, high = number(float(values.min())), number(float(values.max()))
    return text_range(low, high, unit)


def percent(values: FloatArray) -> str:
    """Percent of one or of many operating points as text; ``not known`` where there is none."""
    text = spread(values)
    return text.replace(" (", " % (") if " (" in text else f"{text} %" if text else "not known"


def signed(values: FloatArray) -> str:
    """A change in percent as text, with its sign; ``not known`` where there is none."""
    return re.sub(r"(?<![-\d.])(?!0\.0\b)\d+\.\d", r"+\g<0>", percent(values))


def spread(values: FloatArray) -> str:
    """Percent as text: one number, the ends of a few, the median and quartiles of many; empty if none is known."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return ""
    low, middle, high = (_one_digit(value) for value in np.quantile(known, (0.25, 0.5, 0.75)))
    if known.size < _MANY:
        low, middle, high = (_one_digit(value) for value in (known.min(), np.nan, known.max()))
        return text_range(low, high)
    return middle if low == high else f"{middle} ({low} to {high})"


def _one_digit(value: float) -> str:
    text = f"{value:.1f}"
    return "0.0" if text == "-0.0" else text


def _by_side(part: Contribution, values: FloatArray) -> str:
    """A column of shares as text, drive and coast by themselves where both are there."""
    sides = {side: spread(values[rows]) or "not known" for side, rows in part.sides.items()}
    return ", ".join(f"{side} {text}" if side else text for side, text in sides.items())


def share_rows(part: Contribution) -> tuple[list[str], list[list[str]], list[list[str]]]:
    """The table of one contribution: heads, one row per mechanism, and rows of sums and remainders.

    Args:
        part: Shares of one order or output; of several operating points as `spread` says.
    """
    heads = ["Mechanism", *(DEFINITIONS[name] for name in part.shares)]
    rows = [
        [spoken(mechanism), *(_by_side(part, values[:, at]) for values in part.shares.values())]
        for at, mechanism in enumerate(part.mechanisms)
    ]
    sums = [values.sum(axis=1) for values in part.shares.values()]
    below = [
        ["sum", *(_by_side(part, total) for total in sums)],
        ["closure: 100 - sum", *(_by_side(part, 100 - total) for total in sums)],
        ["all off, P(none)", *([_by_side(part, part.none)] + [""] * (len(sums) - 1))],
    ]
    if part.paper is not None:
        heads.append("paper, 3.5")
        for row, mechanism, share in zip(rows, part.mechanisms, part.paper, strict=True):
            row.append(f"{share:.0f}" if mechanism in PAPER_SHARES else f"{share:.0f} (rest)")
        differences = part.differences()
        below.append(
            ["largest gap to the paper", *(f"{differences[k]:.1f}" if k in differences else "" for k in part.shares)]
        )
        below = [[*row, "100" if row[0] == "sum" else ""] for row in below]
    return heads, rows, below

"""A comparison with a measurement, in sentences, as a table and as JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.comparison.comparison import NONE_IN_MODEL, TOO_SMALL, VERDICTS
from tripod_doe.number_text import count_of, interval, level, number, numbers_in_words, plain_json, value_range
from tripod_doe.page_parts.words import ORDINALS

ORDER_HEADS = (
    "order",
    "measured N",
    "+- N",
    "model N",
    "+- N",
    "difference N",
    "verdict",
    "measured deg",
    "+- deg",
    "model deg",
    "difference deg",
    "+- deg",
)
"""Heads of the table of orders."""

_PHASES = ("measured_phase_deg", "model_phase_deg", "phase_difference_deg")
_ROTATING = 12  # orders that are compared
_TOGETHER = "uncertainties of measurement and model together"
_MOST_DECIMALS = 6
_CONSTANT = 0.05  # percent about its mean below which no beat can be seen
_NOTHING = 1e-9  # part of the largest below which a number is rounding
_DRIFT = 0.02  # of the force per revolution, over the largest order, from which the reader should know
_SPEED_APART = 0.05  # relative difference of speeds from which the reader should know


def find_in_comparison(comparison: xr.Dataset, name: str = "") -> list[str]:
    """Sentences on what the comparison shows, and on what it cannot.

    Args:
        comparison: From `tripod_doe.analyses.comparison.comparison.compare`.

    Returns:
        Doubts about units and pulses first, then which orders differ and which agree, the third order and the second,
        where the error of the model comes from, the run-up, the beat, the alignment, and what was lost.
    """
    sentences = str(comparison.attrs.get("doubts", "")).splitlines()
    sentences += [*_verdict_sentence(comparison), *_asymmetry(comparison)]
    sentences += [_order_sentence(comparison, order) for order in (3, 2)]
    sentences.append(_origin_sentence(comparison))
    if "model_amplitude_at_speed" in comparison:
        sentences += _run_up_sentence(comparison)
    measured, model = (_beat(comparison[f"{which}_envelope"].values) for which in ("measured", "model"))
    sentences.append(f"The envelope of the measured thrust force {measured}; the envelope of the model {model}.")
    sentences += [_revolutions(comparison.attrs), f"Reference angle {comparison.attrs['alignment']}."]
    return sentences + _cautions(comparison)


def _verdict_sentence(comparison: xr.Dataset) -> list[str]:
    """Which orders differ, which agree, and which are too small to tell; nothing if the model has none of them."""
    verdicts = dict(zip(comparison["order"].values.tolist(), comparison["agrees"].values.tolist(), strict=True))
    differ, agree, hidden = (
        [order for order, verdict in verdicts.items() if verdict == asked] for asked in (0, 1, TOO_SMALL)
    )
    small = too_small_text(hidden)
    if not differ and not agree:
        return [nothing_decided(hidden)] if hidden else []
    if not differ:
        every = " all" * (len(agree) == len(verdicts) - 1)
        return [f"{orders_text(agree)}{every} agree{'s' * (len(agree) == 1)} within the {_TOGETHER}{small}."]
    start = f"{orders_text(differ)} {'differ' if len(differ) > 1 else 'differs'} by more than the {_TOGETHER}"
    if not agree:
        return [f"{start}{small or '; none agrees'}."]
    others = orders_text(agree)
    return [f"{start}; {others[:1].lower()}{others[1:]} {'agree' if len(agree) > 1 else 'agrees'}{small}."]


def nothing_decided(orders: list[int]) -> str:
    """The sentence on orders that are smaller than their uncertainties, where no order differs or agrees."""
    what = (
        "Every order is" if len(orders) == _ROTATING else f"{orders_text(orders)} {'are' if len(orders) > 1 else 'is'}"
    )
    return f"{what} smaller than the {_TOGETHER}: no conclusion is possible."


def too_small_text(orders: list[int]) -> str:
    """Orders that agree only since they are smaller than their uncertainties, as the end of a sentence."""
    if not orders:
        return ""
    several = len(orders) > 1
    return (
        f"; {orders_text(orders).lower()} {'are' if several else 'is'} smaller than these uncertainties: no "
        "conclusion is possible"
    )


def _asymmetry(comparison: xr.Dataset) -> list[str]:
    """Orders of the record that the model does not have."""
    own = comparison.isel(order=np.flatnonzero(comparison["agrees"].values == NONE_IN_MODEL))
    groups = own.isel(order=own["order"].values % 3 != 0), own.isel(order=own["order"].values % 3 == 0)
    return [_lacking(group) for group in groups if group.sizes["order"]]


def _lacking(own: xr.Dataset) -> str:
    orders = own["order"].values.tolist()
    largest = own.isel(order=int(np.argmax(own["measured_amplitude"].values)))
    size = interval(float(largest["measured_amplitude"]), float(largest["measured_amplitude_uncertainty"]))
    at = f"up to {size} N (order {int(largest['order'])})" if len(orders) > 1 else f"{size} N"
    return f"{asymmetry_text(orders)}; the record has {at}, more than its scatter: {cause_text(orders)}."


def asymmetry_text(orders: list[int]) -> str:
    """Why a model is zero in some orders: by symmetry in those that three trunnions cancel."""
    symmetric = all(order % 3 for order in orders)
    verb = "are" if len(orders) > 1 else "is"
    return f"{orders_text(orders)} {verb} zero in the model{', whose three trunnions are identical' * symmetric}"


def cause_text(orders: list[int]) -> str:
    """What causes orders that the model does not have; all are multiples of 3, which alike trunnions have, or none."""
    if orders[0] % 3:
        return "the joint (skews, clearances, parts that differ) or the rig (shaft runout, imbalance) is not symmetric"
    return "three trunnions that are alike can cause this, so a finer model may have it"


def orders_text(orders: Sequence[int]) -> str:
    """Orders as the beginning of a sentence: ``Orders 1 to 3 and 6``."""
    return f"Order{'s' * (len(orders) > 1)} {numbers_in_words(orders)}"


def _order_sentence(comparison: xr.Dataset, order: int) -> str:
    over_order = [name for name in comparison.data_vars if comparison[name].dims == ("order",)]
    row = {str(name): float(comparison[name].sel(order=order)) for name in over_order}
    own, computed = row["measured_amplitude_uncertainty"], row["model_amplitude_uncertainty"]
    model, difference = row["model_amplitude"], row["amplitude_difference"]
    known = model > _NOTHING * float(comparison["model_amplitude"].max())
    sign = "+" if difference > 0 else ""
    part = f" ({sign}{number(100 * difference / model, 2)} %)" if known else ""
    if row["agrees"] == NONE_IN_MODEL:
        return f"The measured {ORDINALS[order]} is {interval(row['measured_amplitude'], own)} N, the model's is zero."
    apart = interval(difference, row["amplitude_difference_uncertainty"])
    return (
        f"The measured {ORDINALS[order]} is {interval(row['measured_amplitude'], own)} N, the model's "
        f"{interval(model, computed)} N: a difference of {apart} N{part}, "
        f"{'beyond' if row['agrees'] == 0 else 'within'} both uncertainties together."
    )


def _origin_sentence(comparison: xr.Dataset) -> str:
    """Where the uncertainty of the model comes from, and what it is for the third and the second order."""
    origin = str(comparison.attrs.get("model_uncertainty_origin", ""))
    confidence = f"{100 * float(comparison.attrs['confidence_level']):g} %"
    if not origin:
        return f"Uncertainties are {confidence} intervals. The error of the model is not known here and not included."
    counted = []
    for order in (3, 2):
        model, unsure = (float(comparison[f"model_amplitude{part}"].sel(order=order)) for part in ("", "_uncertainty"))
        if model > _NOTHING * float(comparison["model_amplitude"].max()):
            counted.append(f"+- {number(100 * unsure / model, 2)} % of the {ORDINALS[order]}")
    counts = f"; it amounts to {' and '.join(counted)}" if counted else ""
    return (
        f"Uncertainties are {confidence} intervals. Error of the model {comparison.attrs['model']}: {origin}{counts}."
    )


def _run_up_sentence(comparison: xr.Dataset) -> list[str]:
    """State the third order at both ends of a run-up, as means over a tenth of the revolutions compared."""
    third = comparison.sel(order=3)
    inside = third.isel(revolution=np.flatnonzero(third["model_amplitude_at_speed"].notnull().values)).sortby(
        "speed_rpm"
    )
    tenth = max(inside.sizes["revolution"] // 10, 1)
    ends = [inside.isel(revolution=part).mean("revolution") for part in (slice(None, tenth), slice(-tenth, None))]
    if float(ends[1]["speed_rpm"]) < (1 + _SPEED_APART) * float(ends[0]["speed_rpm"]):
        return []  # a record at one speed
    speeds, measured, model = (
        [number(float(end[name])) for end in ends]
        for name in ("speed_rpm", "thrust_amplitude", "model_amplitude_at_speed")
    )
    return [
        f"From {speeds[0]} to {speeds[1]} rpm the measured third order goes from {measured[0]} to {measured[1]} N, the "
        f"model's from {model[0]} to {model[1]} N."
    ]


def _revolutions(attrs: Mapping[str, Any]) -> str:
    """How many whole revolutions of the record take part."""
    whole, left = int(attrs["revolutions_used"]), int(attrs["revolutions_left_out"])
    compared = int(attrs.get("revolutions_compared", whole))
    why = " for a gap wider than 14.4 deg or too few samples" if left else ""
    speeds = f", {whole - compared} outside of the speeds compared" if compared < whole else ""
    verb = "is" if compared == 1 else "are"
    return (
        f"{compared:,} of {count_of(whole + left, 'whole revolution')} of the record {verb} compared"
        f"{f', {left:,} left out{why}' if left else ''}{speeds}."
    )


def _beat(envelope: np.ndarray[Any, Any]) -> str:
    """Change of an envelope over a revolution, as the end of a sentence."""
    depth = 100 * _depth(envelope)
    return f"rises and falls by {number(depth, 2)} % about its mean" if depth > _CONSTANT else "is constant"


def _depth(envelope: np.ndarray[Any, Any]) -> float:
    """Half the change of an envelope over its mean height, 0 without beat."""
    low, high = float(np.nanmin(envelope)), float(np.nanmax(envelope))
    return (high - low) / (high + low) if high - low > _NOTHING * high else 0.0


def _cautions(comparison: xr.Dataset) -> list[str]:
    attrs, sentences = comparison.attrs, []
    model_speed = attrs.get("model_speed_rpm")
    at_each_speed = "model_amplitude_at_speed" in comparison
    if "speed_rpm" in comparison and model_speed is not None and not at_each_speed:
        speed = comparison["speed_rpm"].values
        if np.abs(speed - model_speed).max() > _SPEED_APART * model_speed:
            sentences.append(
                f"The record was taken at {value_range(float(speed.min()), float(speed.max()), 'rpm')}, the model at "
                f"{level(model_speed)} rpm."
            )
    counts = (
        ("lost_samples", "sample", "without a number"),
        ("lost_pulses", "pulse", "of the tachometer missing and interpolated"),
        ("extra_pulses", "edge", "of the tachometer, which were bounces or spikes"),
    )
    drift = attrs.get("drift_n_per_revolution", 0.0)
    if abs(drift) > _DRIFT * float(comparison["measured_amplitude"][1:].max()):
        sentences.append(
            f"The force drifts by {number(drift, 2)} N per revolution; its contribution to the orders is subtracted."
        )
    sentences += str(attrs.get("remarks", "")).splitlines()
    if attrs.get("columns"):
        sentences.append(f"Columns: {attrs['columns']}.")
    lost = [f"{attrs[key]} {what}{'s' * (attrs[key] > 1)} {words}" for key, what, words in counts if attrs.get(key)]
    return sentences + ([f"Lost: {', '.join(lost)}."] if lost else [])


def comparison_text(comparison: xr.Dataset) -> str:
    """The orders as a table for people, with the sentences above it."""
    rows = pd.DataFrame(order_rows(comparison), columns=list(ORDER_HEADS))
    table = rows.to_string(index=False)
    return "\n".join([*find_in_comparison(comparison), "", table])


def order_rows(comparison: xr.Dataset) -> list[list[str]]:
    """The orders as text, every number to the digits that its uncertainty leaves; an amplitude of zero has no phase."""
    rows, nothing = [], _NOTHING * float(comparison["model_amplitude"].max())
    for order in comparison["order"].values.tolist():
        of_order = {str(name): float(value) for name, value in comparison.sel(order=order).items() if not value.dims}
        of_order |= {name: 0.0 for name, value in of_order.items() if "amplitude" in name and abs(value) <= nothing}
        measured, model, apart = (
            [_rounded(of_order[name], of_order[unsure]), _rounded(of_order[unsure], of_order[unsure])]
            for name, unsure in (
                ("measured_amplitude", "measured_amplitude_uncertainty"),
                ("model_amplitude", "model_amplitude_uncertainty"),
                ("amplitude_difference", "amplitude_difference_uncertainty"),
            )
        )
        sure = of_order["measured_phase_uncertainty_deg"]
        both = of_order["phase_difference_uncertainty_deg"]
        angle, angle_of_model, ahead = (
            _rounded(of_order[name], own) for name, own in zip(_PHASES, (sure, sure, both), strict=True)
        )
        unsure = _rounded(both, both) if math.isfinite(of_order["phase_difference_deg"]) else "-"
        if of_order["model_amplitude"] <= nothing:
            angle_of_model = ahead = unsure = "-"
        verdict = VERDICTS[int(of_order["agrees"])]
        turned = [angle, _rounded(sure, sure), angle_of_model, ahead, unsure]
        rows.append([str(order), *measured, *model, apart[0], verdict, *turned])
    return rows


def _rounded(value: float, unsure: float) -> str:
    """A number to two digits of its uncertainty; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(unsure) and unsure > 0):
        return number(value)
    decimals = max(1 - math.floor(math.log10(unsure)), 0)
    return number(value) if decimals > _MOST_DECIMALS else f"{round(value, decimals) + 0.0:.{decimals}f}"  # no -0.0


def comparison_json(comparison: xr.Dataset) -> str:
    """One JSON object: attributes, every variable over order and revolution by its name, NaN as null."""
    answer: dict[str, Any] = {"point": json.loads(comparison.attrs["point"])}
    answer |= {
        name: value for name, value in comparison.attrs.items() if name not in ("point", "point_units", "history")
    }
    for name in ("order", "revolution", *comparison.data_vars):
        if "rotation_deg" not in comparison[name].dims:
            answer[str(name)] = plain_json(comparison[name].values.tolist())
    for which in ("measured", "model"):
        answer[f"{which}_beat_depth"] = _depth(comparison[f"{which}_envelope"].values)
    answer["findings"] = find_in_comparison(comparison)
    return json.dumps(answer, allow_nan=False, default=lambda value: value.item())

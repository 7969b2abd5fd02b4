"""A comparison with a measurement, in sentences, as a table and as JSON."""

import json
import math
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.page_parts.responses import ORDINALS
from tripod_doe.quantities import interval, level, number, value_range

ORDER_HEADS = (
    "order",
    "measured N",
    "+- N",
    "model N",
    "difference N",
    "measured deg",
    "+- deg",
    "model deg",
    "difference deg",
)
"""Heads of the table of orders."""

_FORCES = ("measured_amplitude", "model_amplitude", "amplitude_difference")
_PHASES = ("measured_phase_deg", "model_phase_deg", "phase_difference_deg")
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
        Doubts about units and pulses first, then the third order, the second, the run-up, the beat, the alignment, and
        what was lost.
    """
    sentences = str(comparison.attrs.get("doubts", "")).splitlines()
    sentences += [_order_sentence(comparison, order) for order in (3, 2)]
    if "model_amplitude_at_speed" in comparison:
        sentences += _run_up_sentence(comparison)
    measured, model = (_beat(comparison[f"{which}_envelope"].values) for which in ("measured", "model"))
    sentences.append(f"The envelope of the measured thrust force {measured}; the envelope of the model {model}.")
    sentences.append(f"Reference angle {comparison.attrs['alignment']}.")
    return sentences + _cautions(comparison)


def _order_sentence(comparison: xr.Dataset, order: int) -> str:
    over_order = [name for name in comparison.data_vars if comparison[name].dims == ("order",)]
    row = {str(name): float(comparison[name].sel(order=order)) for name in over_order}
    own, unsure = row["measured_amplitude_uncertainty"], row["amplitude_difference_uncertainty"]
    model, difference = row["model_amplitude"], row["amplitude_difference"]
    known = model > _NOTHING * float(comparison["model_amplitude"].max())
    sign = "+" if difference > 0 else ""
    part = f" ({sign}{number(100 * difference / model, 2)} %)" if known else ""
    verdict = f", {'within' if row['agrees'] else 'beyond'} its uncertainty" if math.isfinite(unsure) else ""
    return (
        f"The measured {ORDINALS[order]} is {interval(row['measured_amplitude'], own)} N, the model's {number(model)} "
        f"N: a difference of {interval(difference, unsure)} N{part}{verdict}."
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
    if "speed_rpm" in comparison and model_speed is not None:
        speed = comparison["speed_rpm"].values
        if np.abs(speed - model_speed).max() > _SPEED_APART * model_speed:
            sentences.append(
                f"The speed of the record is {value_range(float(speed.min()), float(speed.max()), 'rpm')}, that of the "
                f"model's point {level(model_speed)} rpm."
            )
    counts = (
        ("revolutions_left_out", "revolution", "left out for a gap wider than 14.4 deg or too few samples"),
        ("lost_samples", "sample", "without a number"),
        ("lost_pulses", "pulse", "of the tachometer missing and interpolated"),
        ("extra_pulses", "edge", "of the tachometer, which were bounces or spikes"),
    )
    if "model_error" in attrs:
        off = number(100 * attrs["model_error"], 2)
        sentences.append(f"Model {attrs['model']}: typical error of the third order {off} % against the finest model.")
    drift = attrs.get("drift_n_per_revolution", 0.0)
    if abs(drift) > _DRIFT * float(comparison["measured_amplitude"][1:].max()):
        sentences.append(
            f"The force drifts by {number(drift, 2)} N per revolution; what this adds to the orders is subtracted."
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
        of_order = comparison.sel(order=order)
        cells = [str(order)]
        for names, unsure in (_FORCES, "measured_amplitude_uncertainty"), (_PHASES, "measured_phase_uncertainty_deg"):
            sure = float(of_order[unsure])
            measured, model, difference = (_rounded(float(of_order[name]), sure) for name in names)
            if names is _PHASES and float(of_order["model_amplitude"]) <= nothing:
                model = difference = "-"
            cells += [measured, _rounded(sure, sure), model, difference]
        rows.append(cells)
    return rows


def _rounded(value: float, unsure: float) -> str:
    """A number to two digits of its uncertainty; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(unsure) and unsure > 0):
        return number(value)
    decimals = max(1 - math.floor(math.log10(unsure)), 0)
    return number(value) if decimals > _MOST_DECIMALS else f"{value:.{decimals}f}"


def comparison_json(comparison: xr.Dataset) -> str:
    """One JSON object: attributes, every variable over order and revolution by its name, NaN as null."""
    answer: dict[str, Any] = {"point": json.loads(comparison.attrs["point"])}
    answer |= {
        name: value for name, value in comparison.attrs.items() if name not in ("point", "point_units", "history")
    }
    for name in ("order", "revolution", *comparison.data_vars):
        if "rotation_deg" not in comparison[name].dims:
            answer[str(name)] = _plain(comparison[name].values.tolist())
    for which in ("measured", "model"):
        answer[f"{which}_beat_depth"] = _depth(comparison[f"{which}_envelope"].values)
    answer["findings"] = find_in_comparison(comparison)
    return json.dumps(answer, allow_nan=False, default=lambda value: value.item())


def _plain(values: Any) -> Any:
    if isinstance(values, list):
        return [_plain(value) for value in values]
    return None if isinstance(values, float) and not math.isfinite(values) else values

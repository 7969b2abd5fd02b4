"""One simulated point as text for people: outputs with their labels, three significant digits."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.model_interface import Outcome, Values
from tripod_doe.number_text import count_of, duration, level, level_or_word, number, value_range, with_unit
from tripod_doe.phases import amplitude_of
from tripod_doe.study.simulate import SimulatedPoint

_NOTHING = 1e-9  # amplitudes below this part of the largest one are rounding, and have no phase
_NO_PHASE = "-"


def point_table(point: SimulatedPoint) -> str:
    """Outcome, point, model with its known error, outputs (waveforms by range, no phases of zeros), cost.

    Outputs without any number, as of an unfinished point, are only named.
    """
    detail = f": {point.detail}" if point.detail else ""
    lines = [
        f"outcome  {point.outcome.label}{detail}",
        *_operating_point(point),
        *_largest_orders(point.outputs),
        *(re.sub(r'with model = "(\w+)"', r"with --model \1", note) for note in point.model_notes),
    ]
    unknown = [name for name, values in point.outputs.items() if np.isnan(np.asarray(values.data, float)).all()]
    for name, values in point.outputs.items():
        if name in unknown:
            continue
        unit = point.simulator.outputs[name].unit_text
        if "rotation_deg" in values.dims:
            ends = value_range(float(np.nanmin(values.data)), float(np.nanmax(values.data)), unit)
            lines.append(f"{name}  {ends} over {_turns(point)}")
        elif values.data.ndim == 0:
            lines.append(f"{name}  {with_unit(number(float(values.data)), unit)}")
        else:
            lines += [f"{name} [{unit or '-'}]", *_rows(point, values, _texts(name, values, point.outputs))]
    lines += _without_value(point, unknown)
    cost = point.cost
    lines.append(
        f"cost  CPU {duration(cost['cpu_seconds'])}, wall {duration(cost['wall_seconds'])}, "
        f"{count_of(int(cost['steps']), 'step')}, {count_of(int(cost['force_evaluations']), 'force evaluation')}"
    )
    return "\n".join(lines)


def _turns(point: SimulatedPoint) -> str:
    """Revolutions of a waveform: ``the last 2 of 4 revolutions (rotation_deg 0 to 719)``."""
    angle = np.asarray(point.coordinates["rotation_deg"], float)
    turns, every = round((angle[-1] - angle[0] + angle[1] - angle[0]) / 360), point.parameters.get("cycles")
    whole = f"the last {turns} of {every:g} revolutions" if isinstance(every, int | float) else f"{turns} revolutions"
    return f"{whole} (rotation_deg {level(float(angle[0]))} to {level(float(angle[-1]))})"


def _without_value(point: SimulatedPoint, unknown: list[str]) -> list[str]:
    """Why outputs have no value; those of a point that did not finish are only named."""
    if point.outcome is not Outcome.FINISHED:
        return [f"No value of {', '.join(unknown)}: the point did not finish."] if unknown else []
    return [f"No value of {name}: {point.simulator.outputs[name].meaning}." for name in unknown]


def _operating_point(point: SimulatedPoint) -> list[str]:
    """The point: its operating point, and other given parameters."""
    values, known = point.parameters, point.simulator.parameters
    first = next(iter(known.values())).group if known else ""
    operating = [name for name in known if known[name].group == first and (name in point.given or values.get(name))]
    others = [name for name in point.given if name not in operating]
    texts = [
        ", ".join(f"{name} {level_or_word(values[name])}" for name in names) for names in (operating, others) if names
    ]
    return [f"point  {'; '.join(texts)}"] if texts else []


def _largest_orders(outputs: Mapping[str, Values]) -> list[str]:
    """The answer in one line: the two largest rotating orders of the thrust force, where it has any."""
    if "thrust_amplitude" not in outputs:
        return []
    amplitude = np.asarray(outputs["thrust_amplitude"].data, float)[1:]
    if not np.nanmax(amplitude, initial=0.0) > 0:
        return []
    first, second = (int(place) for place in np.argsort(-np.nan_to_num(amplitude))[:2])
    return [
        f"Largest rotating order of the thrust force: {first + 1} with {number(amplitude[first])} N, "
        f"then {second + 1} with {number(amplitude[second])} N."
    ]


def _texts(name: str, values: Values, outputs: Mapping[str, Values]) -> NDArray[Any]:
    """Numbers as text; rounding errors become zero, and their phases are omitted."""
    data = np.asarray(values.data, float)
    amplitude = outputs.get(amplitude_of(name))
    angle = amplitude is not None
    size = np.abs(np.asarray(amplitude.data, float)) if angle and amplitude is not None else np.abs(data)
    nothing = size <= _NOTHING * np.nanmax(size, initial=0.0)
    texts = [
        (_NO_PHASE if angle else "0") if zero else number(value)
        for value, zero in zip(data.ravel().tolist(), nothing.ravel().tolist(), strict=True)
    ]
    return np.array(texts, dtype=object).reshape(data.shape)


def _rows(point: SimulatedPoint, values: Values, texts: NDArray[Any]) -> list[str]:
    """A table over the last dimension, with a row for each label of the dimensions before it."""
    *before, last = values.dims
    labels = {
        dim: point.coordinates.get(dim, np.arange(size)) for dim, size in zip(values.dims, texts.shape, strict=True)
    }
    lines = [[last, *(str(label) for label in labels[last])]]
    for place in np.ndindex(*texts.shape[:-1]):
        head = ", ".join(f"{dim} {labels[dim][at]}" for dim, at in zip(before, place, strict=True))
        lines.append([head, *texts[place]])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["    " + "  ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])]) for line in lines]

"""Parts that all figures share: axes with units, marks for cells without a number, packed numbers."""

import base64
import re
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import OUTCOME_MEANINGS, Outcome
from tripod_doe.number_text import level, with_unit
from tripod_doe.page_parts.main_results import spaced_by_ratios
from tripod_doe.page_parts.words import spoken, unit_text, with_brackets

Figure = dict[str, Any]
"""A figure as Plotly takes it: ``{"data": [...], "layout": {...}}``."""

NUMBER = "point_number"
"""Coordinate over the dimensions of the design: the number of each point, in the order of the cube."""

IS_DIFFERENCE = "is_difference"
"""Attribute of a variable from which another one is subtracted, so that labels say so."""

FAILED_COLOUR, WAITING_COLOUR = "#b5532a", "#8b96a3"
"""Readable on light and on dark paper."""

SEQUENTIAL = (
    (0.0, "#1f3b73"),
    (0.2, "#26648e"),
    (0.4, "#2a9187"),
    (0.6, "#6bb56b"),
    (0.8, "#c9c94f"),
    (1.0, "#fbe183"),
)
"""Colour scale of heat maps: darker is less, also for readers who do not see colours."""


def packed(values: NDArray[Any]) -> dict[str, str] | list[Any]:
    """Numbers as Plotly reads them fastest: base64 of their bytes; texts as a list."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        return [str(value) for value in array.ravel()]
    kind = "f8" if array.dtype.kind == "f" or array.dtype.itemsize == 8 else "i4"
    array = np.ascontiguousarray(array, "<" + kind)
    typed = {"dtype": kind, "bdata": base64.b64encode(array.tobytes()).decode()}
    return typed | ({"shape": ", ".join(map(str, array.shape))} if array.ndim > 1 else {})


_MARKUP = re.compile(r"<(?!/?b>|br>|/?extra>)")
"""The start of markup, which our figures do not use: Plotly renders links and styles in a text."""


def plain(part: Any) -> Any:
    """A figure, or a part of it, without markup in its texts: names and units may come from a stranger."""
    if isinstance(part, str):
        return _MARKUP.sub("&lt;", part)
    if isinstance(part, dict):
        return {key: value if key == "bdata" else plain(value) for key, value in part.items()}
    return [plain(each) for each in part] if isinstance(part, list) else part


def shown(data: xr.Dataset) -> xr.DataArray:
    """The variable that a figure of this Dataset shows: the first one."""
    return data[next(iter(data.data_vars))]


def label_of(variable: xr.DataArray) -> str:
    """A variable or a coordinate with its unit, as an axis label; names from a user's function get no unit."""
    name, attrs = str(variable.name), variable.attrs
    own = "user function" in (attrs.get("source"), str(attrs.get("long_name", "")).removeprefix("output of a "))
    words = ("difference of " if IS_DIFFERENCE in attrs else "") + (name if own else spoken(name))
    return with_brackets(words, unit_text(str(attrs.get("units", "1"))))


def axis(coordinate: xr.DataArray, **more: Any) -> dict[str, Any]:
    """An axis along a coordinate: logarithmic for levels by ratios, categorical for words."""
    values = coordinate.values
    kind = (
        {"type": "category"}
        if values.dtype.kind not in "fiub"
        else {"type": "log" if spaced_by_ratios(values) else "linear"}
    )
    return {"title": {"text": label_of(coordinate)}, "automargin": True} | kind | more


def colour_bar(label: str) -> dict[str, Any]:
    """The colour bar, which gives the value of each colour."""
    return {"title": {"text": label, "side": "right", "font": {"size": 12.5}}, "thickness": 12, "outlinewidth": 0}


def edges(values: FloatArray, logarithmic: bool) -> FloatArray:
    """Limits of the cells around levels, shape (levels + 1,): midway between neighbours."""
    places = np.log(values) if logarithmic else values
    if places.size == 1:
        half = abs(places[0]) / 20 or 0.5
        limits = np.array([places[0] - half, places[0] + half])
    else:
        middle = (places[1:] + places[:-1]) / 2
        limits = np.concatenate([[2 * places[0] - middle[0]], middle, [2 * places[-1] - middle[-1]]])
    return np.exp(limits) if logarithmic else limits


def level_texts(coordinate: xr.DataArray) -> list[str]:
    """The values of a coordinate with their unit, as a legend names them."""
    unit = unit_text(str(coordinate.attrs.get("units", "1")))
    numbers = coordinate.dtype.kind in "fiu"
    texts = [level(value) if numbers else str(value) for value in np.atleast_1d(coordinate.values).tolist()]
    return [with_unit(text.replace("-", "\N{MINUS SIGN}") if numbers else text, unit) for text in texts]


def ramp(count: int) -> list[str]:
    """Colours of lines for increasing numbers, from the part of the scale that is visible on light and dark paper."""
    places = np.array([place for place, _ in SEQUENTIAL])
    channels = np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for _, colour in SEQUENTIAL], float)
    wanted = np.linspace(0.18, 0.86, count)
    mixed = [np.interp(wanted, places, channel).round().astype(int) for channel in channels.T]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in zip(*mixed, strict=True)]


def is_failed(data: xr.Dataset) -> xr.DataArray:
    """Whether a point ran but gave no numbers."""
    codes = data["outcome"]
    return ~codes.isin([Outcome.FINISHED, Outcome.NOT_RUN, Outcome.NOT_APPLICABLE])


def blank_reasons(data: xr.Dataset) -> NDArray[np.object_]:
    """The reason why a cell holds no number, in the shape of the outcome; empty for a cell with a number."""
    codes = data["outcome"].values
    texts = np.full(codes.shape, "", object)
    for at in zip(*np.nonzero(codes != Outcome.FINISHED), strict=True):
        outcome = Outcome(int(codes[at]))
        reason = str(data["outcome_detail"].values[at]) if "outcome_detail" in data else ""
        texts[at] = f"{outcome.label}: {reason or OUTCOME_MEANINGS[outcome]}"
    return texts


FOOT_AXIS = {"overlaying": "y", "range": [0, 1], "visible": False, "fixedrange": True}
"""The axis of marks at the foot of a figure."""


def blank_marks(
    x: NDArray[Any], y: NDArray[Any], texts: list[str], numbers: NDArray[Any], failed: bool, size: int = 8
) -> Figure:
    """Marks of cells without a number: crosses for failed ones, rings for those still to come, with their reasons."""
    symbol, colour = ("x-thin", FAILED_COLOUR) if failed else ("circle-open", WAITING_COLOUR)
    return {
        "type": "scatter",
        "mode": "markers",
        "showlegend": False,
        "x": packed(x),
        "y": packed(y),
        "text": texts,
        "customdata": packed(numbers),
        "marker": {"symbol": symbol, "size": size, "color": colour, "line": {"width": 2, "color": colour}},
        "hovertemplate": "%{text}<extra></extra>",
    }


def foot_marks(x: NDArray[Any], texts: list[str], numbers: NDArray[Any], failed: bool) -> Figure:
    """The same at the foot of a figure with `FOOT_AXIS`."""
    marks = blank_marks(x, np.full(len(texts), 0.02), texts, numbers, failed)
    return marks | {"yaxis": "y2", "cliponaxis": False, "hovertemplate": "%{x}: %{text}<extra></extra>"}


def point_numbers(data: xr.Dataset) -> xr.DataArray:
    """Numbers of the points or cells, of a Dataset that is `numbered`."""
    return data[NUMBER].astype(np.int32)

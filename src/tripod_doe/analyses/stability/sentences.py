"""Measured and predicted stability limits in sentences and as a table."""

import math

import numpy as np
import xarray as xr

from tripod_doe.analyses.stability.stability import Agreement, Limit, RunKind, map_of, maps
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import capital, count_of, duration, level, number, rounded_down, text_range, with_unit
from tripod_doe.page_parts.words import spoken, unit_text

_HEADS = [
    "Varied",
    "Method",
    "Measured limit",
    "Predicted limit",
    "Limited by",
    "Measured / predicted",
    "Agree",
    "First failure",
    "Wrong, undetected",
]
_LONG = 1e3  # seconds: a rate that small limits nothing
_WORDS = {
    Limit.NONE: "nothing",
    Limit.FRICTION: "friction",
    Limit.CONTACT: "stiffest contact mode",
    Limit.LAG: "lag of the secant slope",
    Limit.TOLERANCE: "tolerance itself",
    Limit.UNKNOWN: "unknown",
}
_WHY = {
    Limit.NONE: "no limit is predicted for this method",
    Limit.LAG: "the rate is the lag of velocities about a frozen state, which is a poor estimate of the error",
    Limit.CONTACT: "the prediction neglects damping and friction of this mode",
    Limit.TOLERANCE: "a step of this method ends at every sample, whatever the tolerance",
}
"""Known reason of a disagreement, by what limits the step."""


def find_in_stability(borders: xr.Dataset, name: str = "") -> list[str]:
    """State how many limits agree with the prediction, undetected failures, and disagreements with their reasons."""
    agrees = borders["agrees"].values
    decided = agrees != Agreement.NOT_DECIDED
    ratio = borders["ratio"].values[np.isfinite(borders["ratio"].values)]
    ends = [number(float(end), 2) for end in (ratio.min(initial=np.inf), ratio.max(initial=-np.inf))]
    spread = (
        f"; where both exist, the ratio of measured to predicted is {' to '.join(dict.fromkeys(ends))}"
        if ratio.size
        else ""
    )
    where = f"{_scene(name)}: " if _scene(name) else ""
    met = decided & np.isfinite(borders["border_high"].values)
    counted = f"{int((agrees[met] == Agreement.YES).sum())} of {int(met.sum())} measured stability limits"
    agreeing = f"{counted} agree with the predicted ones within a factor of {level(borders.attrs['factor'])}{spread}; "
    beyond = int((agrees[~met] == Agreement.YES).sum())
    others = f"{'other ' * bool(met.any())}{'case' if beyond == 1 else 'cases'}"
    none = f"in {beyond} {others} all runs are right, as predicted; "
    right = f"a run counts as right within {level(100 * borders.attrs['limit'])} % of the reference."
    sentences = [*_defaults(borders, where), where + agreeing * bool(met.any()) + none * bool(beyond) + right]
    kind = borders["run_kind"].values
    refused, wrong = (int((kind == which).sum()) for which in (RunKind.REFUSED, RunKind.WRONG))
    error = borders["error"].values[kind == RunKind.WRONG]
    worst = f", at worst {number(100 * error.max())} % off" if wrong else ""
    of = f"of {refused + wrong} runs that are not right"
    sentences.append(
        f"{where}{of if where else of.capitalize()}, {refused} did not finish and {wrong} finished with a wrong "
        f"result{worst}."
        if refused + wrong
        else f"{where}{'no' if where else 'No'} run failed or finished with a wrong result."
    )
    unknown = int((kind == RunKind.UNKNOWN).any(axis=(0, 2)).sum())
    if unknown:
        points = count_of(unknown, "operating point")
        sentences.append(f"{where}{points} without a reference: no two runs agree closely enough.")
    return sentences + [
        _disagreements(borders, m, np.flatnonzero(row)) for m, row in enumerate(agrees == Agreement.NO) if row.any()
    ]


def _scene(name: str) -> str:
    """The scene of the study of a step, by the step's name."""
    return spoken(name.removesuffix("_borders")).capitalize() if name.endswith("_borders") else ""


def _defaults(borders: xr.Dataset, where: str) -> list[str]:
    """Distance of each method's default step or tolerance from the measured limit of the base case."""
    if "default_setting" not in borders:
        return []
    base = borders.isel(case=int(np.flatnonzero(borders["varied"].values == "base")[0]))
    what = "tolerance" if borders.attrs["numerics"] != "step_s" else "step"
    parts = []
    for m, method in enumerate(borders["method"].values.tolist()):
        row = base.isel(method=m)
        default, low, high = (float(row[key]) for key in ("default_setting", "border_low", "border_high"))
        if not math.isfinite(default):
            continue
        said = f"{method} {border_text(borders, default)}"
        if math.isfinite(low) and default <= low:
            times = rounded_down(low / default * (1 + 1e-9))  # limits are kept as logarithms
            none = f"has no limit up to {border_text(borders, low)}, {times} times as large"
            parts.append(f"{said} {none}" if math.isinf(high) else f"{said} is at least {times} times below it")
        elif math.isinf(high):
            parts.append(f"{said} is larger than every {what} that was tried, up to {border_text(borders, low)}")
        elif default >= high:
            parts.append(
                f"{said} is at least {rounded_down(default / high)} times above it, where runs fail or are wrong"
            )
        elif math.isfinite(low):
            parts.append(f"{said} lies between the last right run and the first that is not")
    if not parts:
        return []
    start = f"{where}the" if where else "The"
    return [f"{start} default {what} of each method against its limit, measured at {_place(base)}: {'; '.join(parts)}."]


def _disagreements(borders: xr.Dataset, m: int, cases: np.ndarray) -> str:
    """The limits of one method that disagree with the prediction, with the known reason."""
    rows = [borders.isel(method=m, case=int(c)) for c in cases]
    pairs = [(measured_border(borders, row), border_text(borders, float(row["border_predicted"]))) for row in rows]
    seen = "; ".join(
        f"{_place(row)} measured {answers}, predicted {said}" for row, (answers, said) in zip(rows, pairs, strict=True)
    )
    first = rows[0]
    limited, below = Limit(int(first["limited_by"])), not float(first["border_low"]) >= float(first["border_predicted"])
    text = [_WHY[limited]] if limited in _WHY and not (below and limited is Limit.TOLERANCE) else []
    if below:
        text.append(f"at {_place(first)} {_first_failure(first)}")
    reason = "; ".join(text)
    return f"{first['method'].item()}: {seen}{'. ' if reason else ''}{capital(reason)}."


def _place(row: xr.Dataset) -> str:
    """The factor that differs from the base case, or all factors."""
    varied = str(row["varied"].item())
    own = [str(name) for name in row.coords if name not in ("method", "case", "numerics", "varied")]
    return ", ".join(_level(row, name) for name in ([varied] if varied in own else own)) or "the base case"


def _first_failure(row: xr.Dataset) -> str:
    """State how the first run that is not right ended: with an outcome that says so, or wrong and undetected."""
    if int(row["first_failure"]) == Outcome.FINISHED:
        return "the first run beyond it finished with a wrong result"
    return f"the first run beyond it ended as {Outcome(int(row['first_failure'])).label}: {row['first_detail'].item()}"


def _level(row: xr.Dataset, factor: str) -> str:
    unit = unit_text(str(row[factor].attrs.get("units", "1")))
    return f"{spoken(factor)} {with_unit(level(float(row[factor])), unit)}"


def border_text(borders: xr.Dataset, value: float) -> str:
    """A step with a unit that suits its size, or a tolerance."""
    if not math.isfinite(value):
        return "not known" if math.isnan(value) else "none"
    if borders.attrs["numerics"] != "step_s":
        return number(value, 2)
    return duration(value, 2) if value < _LONG else "none within reach"


def measured_border(borders: xr.Dataset, row: xr.Dataset) -> str:
    """The measured limit between two steps, or beyond the ends of the study."""
    low, high = float(row["border_low"]), float(row["border_high"])
    if math.isinf(high):
        return f"none up to {border_text(borders, low)}" if math.isfinite(low) else "not known"
    if math.isnan(low):
        return f"below {border_text(borders, high)}"
    return text_range(border_text(borders, low), border_text(borders, high))


def stability_table(borders: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Heads and one row per map and method; borders from the first to the last value of the factor."""
    parts = {factor: map_of(borders, factor) for factor in maps(borders)}
    methods = range(borders.sizes["method"])
    return list(_HEADS), [_row(part, part.isel(method=m), factor) for factor, part in parts.items() for m in methods]


def _row(borders: xr.Dataset, part: xr.Dataset, factor: str) -> list[str]:
    """One map of one method."""
    ends = [part.isel(case=c) for c in (0, -1)]
    levels = " to ".join(level(float(end[factor])) for end in ends)
    ratio = part["ratio"].values[np.isfinite(part["ratio"].values)]
    agrees = part["agrees"].values
    decided = int((agrees != Agreement.NOT_DECIDED).sum())
    failures = part["first_failure"].values[part["first_failure"].values != Outcome.NOT_RUN]
    named = [f"{Outcome(int(kind)).label} {int((failures == kind).sum())}" for kind in np.unique(failures)]
    predicted = [border_text(borders, float(end["border_predicted"])) for end in ends]
    limits = dict.fromkeys(_WORDS[Limit(int(kind))] for kind in part["limited_by"].values)
    return [
        f"{spoken(factor)} {with_unit(levels, unit_text(str(part[factor].attrs.get('units', '1'))))}",
        str(part["method"].item()),
        "; ".join(dict.fromkeys(measured_border(borders, end) for end in ends)),
        " to ".join(dict.fromkeys(predicted)),
        ", ".join(limits),
        " to ".join(dict.fromkeys(f"{value:.2f}" for value in (ratio.min(), ratio.max()))) if ratio.size else "",
        f"{int((agrees == Agreement.YES).sum())} of {decided}" if decided else "not decided",
        ", ".join(named) or "none",
        str(int(part["wrong_runs"].sum())),
    ]

"""Sentences and tables of a fit: each unknown, and the records."""

import json
import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from tripod_doe.analyses.fit.estimation.identifiability import COMBINATION, FOUND, ONE_SIDED
from tripod_doe.errors import CubeError
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.number_text import (
    capital,
    count_of,
    interval,
    level,
    number,
    numbers_in_words,
    value_range,
    value_with_ends,
    with_unit,
)
from tripod_doe.page_parts.words import ORDINALS, spoken, unit_text

UNKNOWN_HEADS = ("unknown", "value", "95 % from", "to", "unit", "verdict", "most correlated with")
"""Heads of the table of unknowns."""

RECORD_HEADS = ("record", "order", "measured N", "+- N", "fitted N", "model +- N", "difference N", "note")
"""Heads of the table of records."""

_TEXTS = ("title", "question", "source", "fit", "model", "search_model", "model_error_source")  # attributes of a fit
_CORRELATED = 0.9  # correlation from which the reader should know
_WIDE = 1.3  # root of chi squared over degrees of freedom from which the reader should know
_NO_FIT = 5.0  # the same root, from which on no value fits
_DOUBTFUL = 3.0  # times the error on record, beyond nineteen in twenty points of the record
_EDGE = 1e-6  # relative: how near to its bound an interval ends there
_FAR = 0.3  # deg by which needles turn, from where on their third orders differ by some percent (benchmarks/RESULTS.md)
_PLACES = 3  # of the circle of trunnions
_SHOWN = 3  # combinations and candidates that sentences state


def find_in_fit(fit: xr.Dataset, name: str = "") -> list[str]:
    """Sentences on what the records say, and on what they do not.

    Raises:
        CubeError: If a text is missing that every result of a fit holds.
    """
    if wrong := [text for text in _TEXTS if not isinstance(fit.attrs.get(text), str)]:
        raise CubeError(f"the attribute {wrong[0]} holds no text: this is no result of a fit, or it is damaged")
    names = fit["unknown"].values.tolist()
    known = [name for name in names if _is_known(fit.sel(unknown=name))]
    values = [*_known_sentence(fit, known), *(_unknown_sentence(fit, name) for name in names if name not in known)]
    values += _combined(fit)
    if no_fit := _no_fit(fit):
        values = [text.replace("95 % confidence", "unknown confidence") for text in values]
    sentences = [*str(fit.attrs.get("doubts", "")).splitlines(), *no_fit, *values, *_next_sentences(fit)]
    sentences += _correlated(fit)
    return [*sentences, *_cautions(fit), *str(fit.attrs.get("remarks", "")).splitlines()]


def _no_fit(fit: xr.Dataset) -> list[str]:
    """That no value fits, where the best ones are far off."""
    root = math.sqrt(float(fit.attrs["scatter"]))
    if root <= _NO_FIT:
        return []
    return [
        f"No joint within the bounds fits these records: measured and fitted orders{_or_expected(fit)} differ by "
        f"{number(root, 2)} times what their uncertainties explain. What follows is of the joint that differs least, "
        "with intervals widened by this factor. Check the bounds, the values in [base], the operating points, and sign "
        "and unit of the force."
    ]


def _or_expected(fit: xr.Dataset) -> str:
    """What chi squared counts besides orders."""
    return ", or fitted values and those expected before (mean, std)," if fit.attrs.get("expected_values") else ""


def _unit(name: str) -> str:
    return unit_text(JOINT_PARAMETERS[name].unit)


def _is_known(own: xr.Dataset) -> bool:
    return own["verdict"].item() == FOUND and math.isfinite(float(own["value"]))


def _known_sentence(fit: xr.Dataset, names: list[str]) -> list[str]:
    """One sentence on all unknowns that the records determine."""
    texts = []
    for name in names:
        own = fit.sel(unknown=name)
        value, low, high = (float(own[key]) for key in ("value", "low", "high"))
        texts.append(f"{spoken(name)} is {value_with_ends(value, low, high, _unit(name))}")
    if not texts:
        return []
    whole = ", ".join(texts)
    return [f"{capital(whole)}, with the intervals of 95 % confidence."]


def _unknown_sentence(fit: xr.Dataset, name: str) -> str:
    own = fit.sel(unknown=name)
    low, high = (float(own[key]) for key in ("low", "high"))
    if not math.isfinite(low):
        return _sentence_of_records(own, name)
    return f"{capital(spoken(name))} {_statement(str(own['verdict'].item()), low, high, own, _unit(name))}."


def _statement(verdict: str, low: float, high: float, own: xr.Dataset, unit: str) -> str:
    """Knowledge of a value that is not determined, as the end of a sentence."""
    ends = value_range(low, high, unit)
    if verdict == ONE_SIDED:
        ends_low, ends_high = (
            abs(end - float(own[f"bound_{name}"])) > _EDGE * abs(end) for end, name in ((low, "low"), (high, "high"))
        )
        if ends_low and ends_high:
            return f"lies within {ends}; at one of these ends, points of the model fail"
        side, end = ("at least", low) if ends_low else ("at most", high)
        return (
            f"is {side} {with_unit(number(end), unit)} with 95 % confidence; the records set no other limit within its "
            f"bounds {value_range(float(own['bound_low']), float(own['bound_high']))}"
        )
    if verdict == COMBINATION:
        return f"is known only in combination with other unknowns: by itself it may be anything from {ends}"
    return f"is not identified by these records: any value from {ends} fits about as well as the best"


def _sentence_of_records(own: xr.Dataset, name: str) -> str:
    """Values of an unknown in each record or group, in a sentence."""
    values = own["value_of_record"].values
    words = own["verdict_of_record"].values[list(_first_records(own).values())].tolist()
    counts = ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))
    ends = value_range(float(values.min()), float(values.max()), _unit(name))
    return f"{capital(spoken(name))} differs between records: {ends} ({counts})."


def _combined(fit: xr.Dataset) -> list[str]:
    """Combinations that are known where single unknowns are not."""
    known = json.loads(fit.attrs["combinations"])
    texts = [f"{combination_text(each['parts'])} = {interval(each['value'], each['half'])}" for each in known[:_SHOWN]]
    if not texts:
        return []
    return [f"Known with 95 % confidence: {'; '.join(texts)}."]


def combination_text(parts: list[list[object]]) -> str:
    """A combination of unknowns, as a sum with factors."""
    text = ""
    for name, is_log, factor in parts:
        amount = float(str(factor))
        shown = f"log10 {name}" if is_log else str(name)
        size = "" if abs(abs(amount) - 1) < 0.005 else f"{number(abs(amount), 2)} "
        sign = ("-" if amount < 0 else "") if not text else (" - " if amount < 0 else " + ")
        text += f"{sign}{size}{shown}"
    return text


def _correlated(fit: xr.Dataset) -> list[str]:
    names = fit["unknown"].values.tolist()
    values = fit["correlation"].values
    pairs = [
        f"{first} and {second} ({number(float(values[at, other]), 2)})"
        for at, first in enumerate(names)
        for other, second in enumerate(names)
        if at < other and abs(values[at, other]) >= _CORRELATED
    ]
    return [f"Strongly correlated: {', '.join(pairs)}."] if pairs else []


def _next_sentences(fit: xr.Dataset) -> list[str]:
    """The candidates that narrow the unknown the most."""
    if "next" not in fit or not np.isfinite(fit["next"]).any():
        return []
    part = fit["next"].values
    order = [at for at in np.argsort(part) if math.isfinite(part[at])]
    best = fit.isel(candidate=int(order[0]))
    records = float(best["next_records"])
    within = f"{level(100 * float(fit.attrs['next_within']))} %"
    own = fit.attrs["next_unknown"]
    at = candidate_text(fit, int(order[0]))
    shorter = f"{number(100 * (1 - float(best['next'])), 2)} % shorter"
    apart = " It includes other minima, which that record may exclude." if _reaches_over_others(fit) else ""
    if records == 0:
        return [
            f"{own} is already known within {within}. To know it better, measure at {at}: its "
            f"interval becomes {shorter}.{apart}"
        ]
    if math.isfinite(records):
        more = f" With {count_of(int(records), 'such record')} it would be known within {within}."
    else:
        more = f" More records at that point alone cannot reach {within}."
    return [f"Measure next at {at}: the interval of {own} becomes {shorter}.{apart}{more}"]


def _reaches_over_others(fit: xr.Dataset) -> bool:
    """Whether intervals reach over other minima, or over the values of needles that turn or stay where these do not."""
    return bool(fit.attrs["other_minima"]) or fit.attrs.get("other_skews", "{}") != "{}"


def candidate_text(fit: xr.Dataset, at: int) -> str:
    """The operating values of a candidate in words, and the group of records to which it would belong."""
    names = [str(name) for name in fit.coords if fit[name].dims == ("candidate",) and str(name) != "candidate"]
    parts = []
    for name in names:
        own = name.removeprefix("candidate_")
        value = fit[name].values[at]
        shown = str(value) if isinstance(value, str) else level(float(value))
        parts.append(with_unit(f"{spoken(own)} {shown}", _unit(own)))
    return ", ".join(filter(None, [*parts, str(fit.attrs.get("next_group", ""))]))


def _cautions(fit: xr.Dataset) -> Iterator[str]:
    attrs = fit.attrs
    if bad := [str(name) for name, left in zip(fit["record"].values, fit["left_out"].values, strict=True) if left]:
        yield f"Left out, since no joint within the bounds fits them together with the other records: {', '.join(bad)}."
    root = math.sqrt(float(attrs["scatter"]))
    if _WIDE < root <= _NO_FIT:
        yield (
            f"Measured and fitted orders{_or_expected(fit)} differ by {number(root, 2)} times what their uncertainties "
            "explain; all intervals are widened by this factor."
        )
    if attrs["other_minima"]:
        count = int(attrs["other_minima"])
        minima = count_of(count, "further minimum").replace("minimums", "minima")
        yield f"The records do not exclude {minima}; the intervals include {'it' if count == 1 else 'them all'}."
    yield from _skews_that_stay(fit)
    if attrs["aligned_by_order"]:
        aligned = "the phase of one order of each record aligns it with the model"
        yield f"Without a reference angle, {aligned}.{_skews_alike(fit)}"
    yield f"Error of the model {attrs['model']}: {attrs['model_error_source']}.{_error_size(fit)}"
    if attrs["search_model"] != attrs["model"]:
        yield (
            f"The search ran on {attrs['search_model']}, corrected by {attrs['model']} at "
            f"{count_of(int(attrs['corrections']), 'minimum').replace('minimums', 'minima')}."
        )
    if not attrs["at_rest"]:
        yield "The minimum still moved at the last correction: narrow the bounds, or fit fewer unknowns."
    if attrs.get("failed_points"):
        yield f"{count_of(int(attrs['failed_points']), 'point')} of {attrs['points']:,} failed and were avoided."


def _skews_alike(fit: xr.Dataset) -> str:
    """Which other skews the search began from, where trunnions are not known apart."""
    if not fit.attrs.get("skews_change_places"):
        return ""
    alike = [" / ".join(number(one, 2) for one in each) for each in json.loads(str(fit.attrs.get("skews_alike", "[]")))]
    if not alike:
        shifted = " The trunnions are then interchangeable: skews may be shifted from trunnion to trunnion, 1 to 2 to 3"
        return f"{shifted}{', and all with opposite signs' if fit.attrs.get('sign_of_force_free') else ''}."
    opposite = " or with opposite signs" if len(alike) > _PLACES else ""  # alike where the force's sign is not known
    return (
        f" The trunnions are then interchangeable: skews of {', '.join(alike[1:-1])} and {alike[-1]} deg at trunnions "
        f"1 / 2 / 3, which have the same differences as {alike[0]} deg, on other trunnions{opposite}, give "
        "nearly the same records (exactly the same if needles keep their skew). The search started there, too."
    )


def _skews_that_stay(fit: xr.Dataset) -> Iterator[str]:
    """Whether needles turn or keep their skew, as far as the records say."""
    if (stay := fit.attrs.get("skews_stay")) is None:
        return
    needles = ("needles that turn, as in kinetostatic,", "needles that keep their skew, as in rollers,")
    own, other = needles[::-1] if stay else needles
    values = json.loads(str(fit.attrs["other_skews"]))
    if values:
        texts = ", ".join(f"{name} {number(value, 3)}" for name, value in values.items())
        yield (
            f"The records fit {own} better than {other} by odds of less than 20 to 1: the values assume the former, "
            f"and the intervals cover both. Best values of the latter: {texts}."
        )
    else:
        yield f"The records fit {own} better than {other} by odds of more than 20 to 1: the values assume the former."
    if (turned := float(fit.attrs.get("needles_turn_deg", 0.0))) > _FAR:
        yield (
            f"Needles of kinetostatic turn by up to {number(turned, 2)} deg in these records. If real needles keep "
            "their skew instead, the third order is smaller, by 1 to 11 % at joints where both were computed. This fit "
            "ignores that: its frictions and these odds then do not hold. If needles may keep their skew, fit with "
            'model = "rollers".'
        )


def _error_size(fit: xr.Dataset) -> str:
    """Sizes of the model's errors in these records, as a sentence; empty where they were not estimated."""
    if "model_error_factor" not in fit:
        return ""
    orders: dict[float, list[int]] = {}
    for order, factor in zip(fit["order"].values.tolist(), fit["model_error_factor"].values.tolist(), strict=True):
        orders.setdefault(factor, []).append(order)
    parts = [f"{number(factor, 2)} in order {numbers_in_words(own)}" for factor, own in orders.items()]
    if "phase_error_factor" in fit:
        parts.append(f"{number(float(fit['phase_error_factor']), 2)} in phases")
    text = f" The residuals of the fit scale this error by {', '.join(parts)}."
    if float(fit["model_error_factor"].max()) < _DOUBTFUL:
        return text
    return (
        f"{text} This joint is unlike the recorded ones, and part of the error may have gone into the fitted values: "
        'fit with model = "needles".'
    )


def unknown_rows(fit: xr.Dataset) -> list[list[str]]:
    """Rows of the table of unknowns: one an unknown, or one a record where each has its own."""
    rows = []
    for name in fit["unknown"].values.tolist():
        own = fit.sel(unknown=name)
        partner = _partner(fit, name)
        if math.isfinite(float(own["value"])):
            cells = [number(float(own[key])) for key in ("value", "low", "high")]
            rows.append([name, *cells, _unit(name), str(own["verdict"].item()), partner])
            continue
        for group, at in _first_records(own).items():
            each = own.isel(record=at)
            cells = [number(float(each[f"{key}_of_record"])) for key in ("value", "low", "high")]
            rows.append([f"{name} of {group}", *cells, _unit(name), str(each["verdict_of_record"].item()), partner])
    return rows


def _first_records(own: xr.Dataset) -> dict[str, int]:
    """Groups of records with a value of their own, and the number of the first record of each."""
    groups = own["group_of_record" if "group_of_record" in own else "record"].values.tolist()
    return {group: groups.index(group) for group in groups}


def unknown_table(fit: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """The unknowns with their intervals and verdicts, under their headings."""
    return list(UNKNOWN_HEADS), unknown_rows(fit)


def _partner(fit: xr.Dataset, name: str) -> str:
    """The unknown with which another one is most correlated."""
    own = fit["correlation"].sel(unknown=name).drop_sel(unknown_2=name)
    if not own.size:
        return ""
    at = int(np.argmax(np.abs(own.values)))
    return f"{own['unknown_2'].values[at]} ({number(float(own.values[at]), 2)})"


def record_rows(fit: xr.Dataset) -> list[list[str]]:
    """Rows of the table of records: measured and fitted orders."""
    rows = []
    for record in fit["record"].values.tolist():
        own = fit.sel(record=record)
        for order in fit["order"].values.tolist():
            one = own.sel(order=order)
            measured, error, fitted, model, residual = (
                number(float(one[key])) for key in ("measured", "measured_error", "fitted", "model_error", "residual")
            )
            note = "left out" if int(own["left_out"]) else ""
            rows.append([record, str(order), measured, error, fitted, model, residual, note])
    return rows


def candidate_rows(fit: xr.Dataset) -> list[list[str]]:
    """Rows of the table of candidates, the best first."""
    part = fit["next"].values
    rows = []
    for at in np.argsort(np.where(np.isfinite(part), part, np.inf)):
        own = fit.isel(candidate=int(at))
        predicted = [
            interval(float(own["predicted"].sel(order=order)), float(own["predicted_error"].sel(order=order)))
            for order in fit["order"].values
        ]
        records = float(own["next_records"])
        shown = number(records) if math.isfinite(records) else "not there alone"
        rows.append([candidate_text(fit, int(at)), number(100 * (1 - part[at]), 2), shown, *predicted])
    return rows


def candidate_heads(fit: xr.Dataset) -> list[str]:
    """Heads of the table of candidates."""
    within = f"{level(100 * float(fit.attrs['next_within']))} %"
    orders = [f"{ORDINALS[int(order)]} N" for order in fit["order"].values]
    return ["operating point", "interval shorter by %", f"records until within {within}", *orders]


def fit_lines(fit: xr.Dataset) -> list[str]:
    """The result for a terminal: the table of unknowns, then sentences."""
    rows = [list(UNKNOWN_HEADS), *unknown_rows(fit)]
    widths = [max(len(row[at]) for row in rows) for at in range(len(UNKNOWN_HEADS))]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return [*table, "", *find_in_fit(fit)]

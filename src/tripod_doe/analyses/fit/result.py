"""The result of a fit as a cube: values, intervals and verdicts, measured and fitted, what to measure next."""

import json
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.fit.estimation.identifiability import (
    COMBINATION,
    FOUND,
    NOT_IDENTIFIED,
    ONE_SIDED,
    correlation_of,
)
from tripod_doe.analyses.fit.estimation.solution import CONFIDENCE, Solution
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.analyses.fit.fit_file import FitRequest
from tripod_doe.analyses.fit.model_error import ModelError
from tripod_doe.analyses.fit.next_record import Next
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.records import RigRecord
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.array_types import FloatArray
from tripod_doe.joint.orders import amplitude_and_phase
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.number_text import count_of, value_range
from tripod_doe.study.query.look_for_sentence import found_rows

_RANK = (FOUND, ONE_SIDED, COMBINATION, NOT_IDENTIFIED)
"""Verdicts from the best to the worst."""

_POINTS = 41  # of a profile, as it is stored
_NORMAL = 1.96  # deviations of half a 95 % interval


@makes_kind("fit")
def fit_dataset(
    rig: FitProblem, solution: Solution, error: ModelError, following: Next | None, doubts: Sequence[str] = ()
) -> xr.Dataset:
    """Label the result of a fit.

    Args:
        doubts: Sentences on what is probably wrong with all records.
    """
    layout, records, width = solution.problem.layout, rig.records, len(rig.orders)
    variables = _unknowns(layout, solution) | _records(solution, error, width)
    if solution.error_size.factors:
        meaning = _meaning("1", "errors of the model in these records, relative to recorded ones")
        variables["model_error_factor"] = ("order", solution.error_size.of(rig.orders)[0], meaning)
        if error.turning.any() and not solution.problem.misfit.rows.free_phase.all():
            meaning = _meaning("1", "errors of phases beyond the errors of amplitudes, relative to recorded ones")
            variables["phase_error_factor"] = ((), solution.error_size.phases, meaning)
    if any(unknown.per != "all" for unknown in layout.unknowns):
        variables |= _by_record(layout, solution)
    unknown_names = [unknown.name for unknown in layout.unknowns]
    coordinates: dict[str, Any] = {
        "unknown": ("unknown", unknown_names, {"long_name": "parameter that is fitted"}),
        "unknown_2": ("unknown_2", unknown_names, {"long_name": "parameter that is fitted"}),
        "record": ("record", list(rig.record_names), {"long_name": "file of the record"}),
        "order": ("order", np.array(rig.orders, np.int32), _meaning("1", "rotating order")),
    }
    for name in dict.fromkeys(name for record in records for name in record.parameters):
        values = [record.parameters.get(name, np.nan) for record in records]
        coordinates[name] = ("record", values, _of_parameter(name))
    remarks = [*_by_record_names(records, "remarks"), *_out_of_range(rig, solution)]
    doubts = [*_by_record_names(records, "doubts"), *doubts]
    attrs = _attributes(rig, solution, error) | {"remarks": "\n".join(remarks), "doubts": "\n".join(doubts)}
    if following is not None:
        more, places = _candidates(following, width)
        variables |= more
        coordinates |= places
        attrs |= {"next_unknown": following.unknown, "next_within": following.within, "next_group": following.group}
    return xr.Dataset(variables, coordinates, attrs)


def found_unknowns(request: FitRequest, fit: xr.Dataset) -> str:
    """The sentence on the unknowns that meet the condition of a fit; empty where it has none."""
    return found_rows(request.file.fit.look_for, fit, "value", ["unknown"], "unknown")


def _by_record_names(records: Sequence[RigRecord], kind: str) -> list[str]:
    """Remarks on the records as they were read, or doubts, a line each; common ones once."""
    by_text: dict[str, list[str]] = {}
    for record in records:
        for remark in getattr(record, kind):
            by_text.setdefault(remark, []).append(record.name)
    lines = []
    for text, names in by_text.items():
        of = f"{names[0]}: " if len(names) == 1 else f"{count_of(len(names), 'record')}: "
        lines.append(of + text)
    return lines


def _out_of_range(rig: FitProblem, solution: Solution) -> list[str]:
    """Ranges of the model that records leave with the fitted unknowns, a line each."""
    values = solution.problem.layout.values(solution.best.place[None])[0]
    columns = rig.columns([record.parameters for record in rig.records], values, rig.model)
    errors = rig.simulator.model_errors(rig.all_columns(columns))
    lines = []
    for each in errors.departures if errors is not None else ():
        if own := int(each.outside.sum()):
            first = rig.record_names[int(each.outside.argmax())]
            ends = value_range(float(each.values.min()), float(each.values.max()))
            where = f"{own} of {count_of(len(rig.records), 'record')}, the first {first}"
            text = f"{each.left.left_by(ends)}; {each.left.reason}"
            lines.append(f"Model {each.model} is outside its valid range at {where}: {text}.")
    return lines


def _meaning(unit: str, meaning: str) -> dict[str, str]:
    return {"units": unit, "long_name": meaning}


def _of_parameter(name: str) -> dict[str, str]:
    parameter = JOINT_PARAMETERS[name]
    return _meaning(parameter.unit, parameter.meaning)


def _ends(layout: Layout, solution: Solution) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Values of the scalars and the ends of their intervals."""
    places = [solution.best.place]
    places += [np.array([getattr(own, end) for own in solution.profiles]) for end in ("low", "high")]
    value, low, high = (layout.physical(np.clip(place, 0, 1)) for place in places)
    return value, low, high


def _unknowns(layout: Layout, solution: Solution) -> dict[str, Any]:
    """Variables over the unknowns; numbers of those that are shared by all records only."""
    count = len(layout.unknowns)
    value, low, high = _ends(layout, solution)
    shared = [list(dict.fromkeys(layout.index[which].tolist())) for which in range(count)]
    rows = [[part[own[0]] if len(own) == 1 else np.nan for own in shared] for part in (value, low, high)]
    verdicts = [max((solution.verdicts[s] for s in own), key=_RANK.index) for own in shared]
    mean, first = np.zeros((2, count, layout.count))
    for which, own in enumerate(shared):
        mean[which, own], first[which, own[0]] = 1 / len(own), 1
    correlation, of_first = (correlation_of(part @ solution.covariance @ part.T) for part in (mean, first))
    _, singular, directions = np.linalg.svd(solution.jacobian, full_matrices=False)
    profiles = _profiles(layout, solution, shared)
    meaning = {"comment": "not a number where each record or group has its own: see value_of_record"}
    return profiles | {
        "value": ("unknown", rows[0], _meaning("1", "fitted value, in the unit of the parameter") | meaning),
        "low": ("unknown", rows[1], _meaning("1", f"lower end of its {100 * CONFIDENCE:g} % interval") | meaning),
        "high": ("unknown", rows[2], _meaning("1", f"upper end of its {100 * CONFIDENCE:g} % interval") | meaning),
        "verdict": ("unknown", np.array(verdicts, object), {"long_name": "verdict on it, the worst of its values"}),
        "bound_low": ("unknown", [u.low for u in layout.unknowns], _meaning("1", "lower bound of the search")),
        "bound_high": ("unknown", [u.high for u in layout.unknowns], _meaning("1", "upper bound of the search")),
        "correlation": (
            ("unknown", "unknown_2"),
            correlation,
            _meaning("1", "correlation of the fitted values; of their means over records where each has its own"),
        ),
        "correlation_in_first": (
            ("unknown", "unknown_2"),
            of_first,
            _meaning("1", "correlation of the fitted values in the first record"),
        ),
        "singular_value": (
            "direction",
            singular,
            _meaning("1", "range of a direction of the unknowns over its standard deviation"),
        ),
        "direction_part": (
            ("direction", "unknown"),
            np.stack([np.linalg.norm(directions[:, own], axis=1) for own in shared], axis=1),
            _meaning("1", "part of an unknown in a direction"),
        ),
    }


def _profiles(layout: Layout, solution: Solution, shared: list[list[int]]) -> dict[str, Any]:
    """Profiles of the unknowns that all records share, at the points that were computed."""
    longest = max(own.places.size for own in solution.profiles)
    longest = min(longest, _POINTS)
    values, growth = np.full((2, len(shared), longest), np.nan)
    for which, own in enumerate(shared):
        if len(own) == 1:
            profile = solution.profiles[own[0]]
            count = min(profile.places.size, longest)
            values[which, :count] = layout.unknowns[which].physical(profile.places[:count])
            growth[which, :count] = profile.growth[:count]
    dims = ("unknown", "profile_point")
    return {
        "profile_value": (dims, values, _meaning("1", "value along the profile, in the unit of the parameter")),
        "profile_growth": (dims, growth, _meaning("1", "growth of chi squared, all other unknowns at their best")),
    }


def _by_record(layout: Layout, solution: Solution) -> dict[str, Any]:
    """Value, interval and verdict of each unknown in each record."""
    value, low, high = _ends(layout, solution)
    dims = ("unknown", "record")
    words, groups = (np.array(texts, object)[layout.index] for texts in (solution.verdicts, layout.groups))
    return {
        "value_of_record": (dims, value[layout.index], _meaning("1", "fitted value in a record")),
        "low_of_record": (dims, low[layout.index], _meaning("1", "lower end of its 95 % interval")),
        "high_of_record": (dims, high[layout.index], _meaning("1", "upper end of its 95 % interval")),
        "verdict_of_record": (dims, words, {"long_name": "verdict on it"}),
        "group_of_record": (dims, groups, {"long_name": "record or group that the value is of; empty for all records"}),
    }


def _records(solution: Solution, error: ModelError, width: int) -> dict[str, Any]:
    """Measured and fitted, over record and order."""
    rows = solution.problem.misfit.rows
    compared = solution.problem.compare(solution.best.prediction, solution.best.place)
    measured, measured_phase = amplitude_and_phase(rows.measured)
    fitted, fitted_phase = amplitude_and_phase(compared.aligned)
    shape, dims = (rows.records, width), ("record", "order")
    half = f"half of the {100 * CONFIDENCE:g} % interval of"

    def table(values: FloatArray, unit: str, meaning: str) -> Any:
        return dims, np.asarray(values).reshape(shape), _meaning(unit, meaning)

    return {
        "measured": table(measured, "N", "measured amplitude, mean over revolutions"),
        "measured_error": table(_NORMAL * rows.along, "N", f"{half} it, from the scatter between revolutions"),
        "fitted": table(fitted, "N", "amplitude of the fitted model"),
        "model_error": table(_NORMAL * error.whole, "N", f"{half} the model's amplitude"),
        "residual": table(measured - fitted, "N", "measured minus fitted amplitude"),
        "measured_phase_deg": table(measured_phase, "degree", "measured phase"),
        "fitted_phase_deg": table(fitted_phase, "degree", "phase of the fitted model, aligned with the record"),
        "misfit": (
            "record",
            np.sqrt(_chi2_of_all(solution) / (2 * width)),
            _meaning("1", "root mean square of measured minus fitted complex amplitudes over their deviations"),
        ),
        "left_out": (
            "record",
            solution.bad.astype(np.int8),
            _meaning("1", "1 where the record does not fit the others and was left out"),
        ),
    }


def _chi2_of_all(solution: Solution) -> FloatArray:
    """Chi squared of each record, also of those left out."""
    from tripod_doe.analyses.fit.estimation.misfit import Misfit

    problem = solution.problem
    every = Misfit(problem.misfit.rows, np.ones_like(solution.bad), problem.layout.priors())
    prediction = solution.best.prediction
    if not np.isfinite(prediction).all():
        return problem.compare(np.nan_to_num(prediction), solution.best.place).chi2
    return every.compare(prediction, solution.best.place).chi2


def _candidates(following: Next, width: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables over the candidates, and their operating values as coordinates."""
    gains = following.gains
    part = [np.nan if gain is None else gain.part for gain in gains]
    records = [np.nan if gain is None else gain.records for gain in gains]
    predicted = [np.full(width, np.nan) if one is None else one for one in following.predicted]
    half = [np.full(width, np.nan) if gain is None else gain.half for gain in gains]
    own = following.unknown
    variables = {
        "next": (
            "candidate",
            part,
            _meaning("1", f"half width of the interval of {own} with one more record here, over that without"),
        ),
        "next_records": (
            "candidate",
            records,
            _meaning("1", f"records here until {own} is known within {100 * following.within:g} %"),
        ),
        "predicted": (("candidate", "order"), np.array(predicted), _meaning("N", "predicted amplitude")),
        "predicted_error": (("candidate", "order"), np.array(half), _meaning("N", "half of its 95 % interval")),
    }
    places = {
        f"candidate_{name}": ("candidate", list(values), _of_parameter(name))
        for name, values in following.operating.items()
    }
    return variables, places


def _attributes(rig: FitProblem, solution: Solution, error: ModelError) -> dict[str, str | float | int]:
    """Provenance, and what is known of the fit as a whole."""
    layout, alike = solution.problem.layout, list(rig.skews_alike(solution.best.place).values())
    names, logs = layout.names(), [layout.unknowns[which].log for which in layout.owner]
    combined = [
        {
            "parts": [[names[scalar], logs[scalar], factor] for scalar, factor in each.parts],
            "value": each.value,
            "half": each.half,
        }
        for each in solution.combinations
    ]
    return {
        "Conventions": "CF-1.8",
        "title": rig.file.fit.name,
        "question": rig.file.fit.question,
        "source": f"tripod-doe {version('tripod-doe')}",
        "fit": rig.request.text,
        "model": rig.model,
        "search_model": rig.cheap,
        "corrections": solution.corrections,
        "at_rest": int(solution.at_rest),
        "model_error_source": error.source,
        "confidence_level": CONFIDENCE,
        "chi_squared": solution.best.cost,
        "degrees_of_freedom": solution.freedom,
        "scatter": solution.scatter,
        "expected_values": solution.problem.misfit.expected,
        "growth_at_ends": solution.allowed,
        "records_left_out": int(solution.bad.sum()),
        "aligned_by_order": int(solution.problem.misfit.rows.free_phase.any()),
        "skews_change_places": int(rig.skews_change_places),
        "sign_of_force_free": int(solution.problem.misfit.rows.free_sign.all()),
        "skews_alike": json.dumps(alike[0] if len(alike) == 1 else []),
        "other_minima": len(solution.others),
        **_skews(layout, solution),
        "combinations": json.dumps(combined),
        "scalars": json.dumps(names),
    }


def _skews(layout: Layout, solution: Solution) -> dict[str, str | float | int]:
    """Which needles the values are of, where both were looked at, and the values with the others."""
    if (skews := solution.skews) is None:
        return {}
    other = {} if skews.other is None else dict(zip(layout.names(), layout.physical(skews.other).tolist(), strict=True))
    lead = {"skews_stay": int(skews.stay), "skews_lead": skews.lead, "needles_turn_deg": skews.turned}
    return lead | {"other_skews": json.dumps(other)}

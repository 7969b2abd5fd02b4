"""Findings of a study: sentences with numbers from its cube."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.failing_region.failing_region import failing_region_of
from tripod_doe.analyses.main_effects.sentences import effects_on, find_effects, unseparated
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS
from tripod_doe.model_interface import NOT_REPRESENTED, Outcome
from tripod_doe.number_text import capital, count_of, digits_apart, level, number, text_range, with_unit
from tripod_doe.page_parts.chosen_models import asked_orders, is_chosen, mixed_formulas
from tripod_doe.page_parts.main_results import (
    ERRORS,
    Response,
    asked,
    computed_once,
    design_kind,
    factor_names,
    finished,
    phases_all_round,
    point_columns,
    points_in_words,
    representative_points,
    responses,
    varies,
    waiting,
)
from tripod_doe.page_parts.subset import shown_subset, subset_sentences
from tripod_doe.page_parts.words import ORDINALS, factor_label, factor_text, listed
from tripod_doe.phases import JUMPS

_FLAT = 1e-6  # part of the largest value below which a value is zero, and a difference none
_MOST_GIVEN = 40  # a factor with more values than this is a sampled one
_MOST_DIGITS = 6
_MOST_NAMED = 3  # factors that can identify a point


def find(cube: xr.Dataset) -> list[str]:
    """Sentences on what the cube shows: the dominant order, the effect of every factor, and what did not finish.

    Returns:
        The most important first.
    """
    good, total = int(finished(cube).sum()), int(asked(cube).sum())
    part = shown_subset(cube)
    if good == 0:
        return _unfinished(cube, part, good, total)
    sentences, shown = [], representative_points(part)
    if bool(finished(shown).any()):
        every_order = "thrust_amplitude" in cube and asked_orders(cube) is None
        weighted = design_kind(cube) in SAMPLED_DESIGNS  # there a point that is drawn twice counts twice
        sentences = [_dominant_order(shown if weighted else computed_once(shown))] if every_order else []
        sentences += _responses(shown) + _missing_effects(shown) + subset_sentences(part)
        if design_kind(cube) == "multifidelity":
            sentences.append(
                f"Ranges of results, effects of factors and their figures refer to "
                f"{points_in_words(shown).removeprefix('of ')}."
            )
    if "attempt" in cube and (changed := int(((cube["attempt"] > 0) & finished(cube)).sum())):
        sentences.append(f"{changed:,} of {total:,} points finished only after a retry.")
    if "accuracy_met" in cube:
        sentences.append(_chosen(cube))
    unfinished = _unfinished(cube, part, good, total)
    return (unfinished + sentences if good < total / 2 else sentences + unfinished) + _notes(cube)


def _unfinished(cube: xr.Dataset, part: xr.Dataset, good: int, total: int) -> list[str]:
    """Number of failed points, with the reasons and the region (of a part), and how many are not computed yet."""
    left = int(waiting(cube).sum())
    failed, sentences = total - good - left, []
    if failed:
        none = failed == total
        start = f"None of {total:,} points finished" if none else f"{failed:,} of {total:,} points did not finish"
        sentences.append(f"{start}: {_reasons(cube)}.")
        if region := failing_region_of(part):
            share = "All" if region.failed == region.all_failed else "Most"
            sentences.append(f"{share} of them are close together: points fail {region.text}.")
    if left:
        sentences.append(f"{left:,} of {total:,} points {'is' if left == 1 else 'are'} not computed yet.")
    return sentences


def _responses(cube: xr.Dataset) -> list[str]:
    """The range of each response and the effects of the factors on it, then what the design does not separate."""
    sentences, lost = [], []
    for response in responses(cube):
        if range_text := _range(response, cube):
            sentences.append(range_text)
        if missing := int((finished(cube) & response.values.isnull()).sum()):
            total = int(finished(cube).sum())
            sentences.append(f"{_named(response)} has no finite value at {missing:,} of {total:,} finished points.")
        values = response.values.values[np.isfinite(response.values.values)]
        if values.size and np.ptp(values) > _FLAT * np.abs(values).max():
            effects = effects_on(response, cube)
            sentences.extend(find_effects(response, cube, effects))
            lost.extend(effects)
    round_ = [f"{name}: {JUMPS}; its values lie all round." for name in phases_all_round(cube)]
    return sentences + round_ + unseparated(cube, lost) + _one_level(cube)


def _missing_effects(cube: xr.Dataset) -> list[str]:
    """Name the factors whose effect no model of the study includes in full, or at all."""
    missing = json.loads(str(cube.attrs.get("missing_effects", "{}")))
    sentences = []
    for factor in factor_names(cube):
        if factor in missing and np.unique(cube[factor].values).size > 1:
            label, why = factor_label(cube, factor), missing[factor]
            none = f"{capital(label)} is {why}: all of its values give the same thrust."
            partly = f"The effect of {label} is incomplete: {why}."
            sentences.append(none if why.startswith(NOT_REPRESENTED) else partly)
    return sentences


def _notes(cube: xr.Dataset) -> list[str]:
    """Limits of the design, and the number of finished points with a note, with the first note."""
    design = [f"The design: {note}." for note in str(cube.attrs.get("design_notes", "")).splitlines()]
    if "outcome_detail" not in cube:
        return design
    cube = computed_once(cube)
    details = cube["outcome_detail"].values[finished(cube).values]
    noted = details[details != ""]
    text = f"{count_of(noted.size, 'point')} finished with a note (outcome_detail)"
    return design + ([f"{text}, the first: {noted[0]}."] if noted.size else [])


def _chosen(cube: xr.Dataset) -> str:
    """State at how many points each model was chosen, and how many will probably miss the accuracy."""
    inside = asked(cube).values
    counts_text = ""
    if not is_chosen(cube):
        count = f"all {int(inside.sum()):,} points run with the full model"
        return f"The study has too few points for a pilot that could choose its models: {count}."
    if "model_used" in cube:
        used = cube["model_used"]
        words = dict(zip(used.attrs.get("flag_values", ()), used.attrs.get("flag_meanings", "").split(), strict=True))
        models, counts = np.unique(used.values[inside], return_counts=True)
        counts_text = ": " + ", ".join(
            f"{words.get(m, f'{m:g}')} at {n:,}" for m, n in zip(models, counts, strict=True)
        )
    unmet = int((cube["accuracy_met"].values[inside] == 0).sum())
    short = f"; {unmet:,} are not expected to meet the accuracy with its confidence" if unmet else ""
    return f"The model was chosen for each point{counts_text} of {int(inside.sum()):,} points{short}.{_not_asked(cube)}"


def _not_asked(cube: xr.Dataset) -> str:
    """State that other orders and the waveform are not shown; empty if they are not in the cube."""
    orders = asked_orders(cube)
    if orders is None:
        return ""
    others = " and the waveform" if "thrust" in cube else ""
    asked = listed([ORDINALS[order] for order in orders])
    formulas = mixed_formulas(cube)
    users = f", nor {listed(formulas)} which may use them" if formulas else ""
    return (
        f" Accuracy was asked for the {asked} only: other orders{others} are not shown{users}, since the model "
        "was not chosen for them."
    )


def _reasons(cube: xr.Dataset) -> str:
    outcome = cube["outcome"].values[asked(cube).values]
    counts = {kind: int((outcome == kind).sum()) for kind in Outcome if kind not in (Outcome.FINISHED, Outcome.NOT_RUN)}
    return ", ".join(f"{count:,} {kind.label}" for kind, count in counts.items() if count)


def _dominant_order(cube: xr.Dataset) -> str:
    amplitude = cube["thrust_amplitude"]
    mean = amplitude.mean([dim for dim in amplitude.dims if dim != "order"]).isel(order=slice(1, None))
    first, second = (int(mean["order"].values[i]) for i in np.argsort(mean.values)[::-1][:2])
    if float(mean.sel(order=first)) == 0:
        return "The thrust force has no rotating order: all amplitudes are zero."
    points = points_in_words(cube)
    size, over = _mean_text(amplitude.sel(order=first), points)
    next_size, _ = _mean_text(amplitude.sel(order=second), points)
    rotating = amplitude.isel(order=slice(1, None)).fillna(-1)
    beyond = rotating.max("order") - rotating.sel(order=first)
    other = int(((beyond > _insignificant_difference(cube)) & finished(cube)).sum())
    text = f"; at {other:,} of {int(finished(cube).sum()):,} points another order is larger" if other else ""
    return (
        f"The {ORDINALS[first]} of the thrust force is the largest: {size} N{over}; "
        f"the next is the {ORDINALS[second]} with {next_size} N{text}."
    )


def _mean_text(amplitude: xr.DataArray, points: str) -> tuple[str, str]:
    """A mean over the points, and over what; of several models its range, as a mean over models belongs to no joint.

    Args:
        points: Which points these are, if not all of the study.
    """
    over = f" on average {points or 'over the study'}" if amplitude.count() > 1 else ""
    models, everywhere = _by_model(amplitude)
    if len(models) < 2:
        return number(float(amplitude.mean())), over
    least, most = min(models.values()), max(models.values())
    digits = min(digits_apart(least, most), _MOST_DIGITS)
    if everywhere is None:
        over = " on average, each model over points of its own"
    else:
        over = f"{over if everywhere else ' on average over the points that all models have'}, depending on the model"
    return text_range(number(least, digits), number(most, digits)), over


def _by_model(amplitude: xr.DataArray) -> tuple[dict[str, float], bool | None]:
    """The mean amplitude with each model over the points that all of them have, and whether these are all points.

    Of models that share no points (None) each mean is over its own; empty where the study has one model.
    """
    if "model" not in amplitude.coords or amplitude["model"].ndim == 0:
        return {}, True
    if "model" in amplitude.dims:
        amplitude = amplitude.dropna("model", how="all")
        shared = amplitude.notnull().all("model")
    else:
        shared = _where_all_models_are(amplitude)
    everywhere = bool((shared == amplitude.notnull()).all()) if bool(shared.any()) else None
    means = (amplitude if everywhere is None else amplitude.where(shared)).groupby("model").mean(...)
    values = zip(means["model"].values, means.values, strict=True)
    return {str(name): float(value) for name, value in values if value == value}, everywhere


def _where_all_models_are(amplitude: xr.DataArray) -> xr.DataArray:
    """Whether every model has a value with the other factors of a point, shape (point,)."""
    known, dims = amplitude.notnull(), amplitude["model"].dims
    factors = {str(name): own.values for name, own in amplitude.coords.items() if own.dims == dims}
    table = pd.DataFrame(factors)[known.values].drop(columns=["point", "varied"], errors="ignore")
    settings = table.assign(any=0).groupby([*table.columns.drop("model"), "any"], dropna=False)
    shared = known.copy()
    shared[known.values] = settings["model"].transform("nunique").values == table["model"].nunique()
    return shared


def _insignificant_difference(cube: xr.Dataset) -> xr.DataArray:
    """Differences below this are not significant: numerical errors, or rounding to zero."""
    amplitude = cube["thrust_amplitude"]
    error = _FLAT * float(amplitude.max()) + xr.zeros_like(cube["outcome"], dtype=float)
    for name in ERRORS:
        if name in cube:
            error = error + 2 * cube[name].isel(order=slice(1, None)).max("order").fillna(0.0)
    return error


def _named(response: Response) -> str:
    """A response at the head of a sentence; a user's variable keeps its name."""
    return response.label if response.key == response.label else f"The {response.label}"


def _range(response: Response, cube: xr.Dataset) -> str:
    """Range of a response, with the points of the smallest and the largest value; empty without any."""
    values = response.values.values
    known = values[np.isfinite(values)]
    if known.size == 0:
        return ""
    low, high, largest = float(known.min()), float(known.max()), float(np.abs(known).max())
    name = _named(response)
    if known.size == 1 or high - low <= _FLAT * largest:
        same = "" if known.size == 1 else " the same at all points:"
        return f"{name} is{same} {with_unit(number(high), response.unit)}."
    ends, digits = [], digits_apart(low, high)
    for value, at in ((low, np.nanargmin(values)), (high, np.nanargmax(values))):
        text = with_unit(number(0.0 if abs(value) < _FLAT * largest else value, digits), response.unit)
        ends.append(text + _point_text(cube, int(at)))
    return f"{name} lies between {ends[0]} and {ends[1]}."


def _point_text(cube: xr.Dataset, at: int) -> str:
    """The point with this number in brackets, described by its varying factors; empty if they are too many."""
    columns = point_columns(cube, np.ones(cube["outcome"].shape, bool))
    varying = {name: column for name, column in columns.items() if varies(column)}
    if not 0 < len(varying) <= _MOST_NAMED:
        return ""
    parts = []
    for name, column in varying.items():
        value = column[at].item()
        given = level if np.unique(column).size <= _MOST_GIVEN else number  # a sampled value has too many digits
        parts.append(factor_text(cube, name, value, given))
    return f" (at {', '.join(parts)})"


def _one_level(cube: xr.Dataset) -> list[str]:
    """Factors with only one finished level, so that their effect is unknown."""
    every = point_columns(cube, np.ones(cube["outcome"].shape, bool))
    done = point_columns(cube, finished(cube).values)
    lost = [name for name in every if varies(every[name]) and done[name].size and not varies(done[name])]
    parts = []
    for name in lost:
        value = done[name][0].item()
        parts.append(factor_text(cube, name, value))
    several = "these factors" if len(parts) > 1 else "this factor"
    return [f"Only points with {listed(parts)} finished: the effect of {several} is not known."] if parts else []

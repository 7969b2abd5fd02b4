"""Findings of a study: sentences with numbers from its cube."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from tripod_doe.report.responses import (
    ORDINALS,
    Effect,
    Response,
    asked,
    design_kind,
    factor_label,
    factor_names,
    factor_unit,
    finished,
    listed,
    main_effect,
    number,
    numeric_factors,
    responses,
    with_all_on,
    with_unit,
)
from tripod_doe.simulator import Outcome

__all__ = ["find"]

_FLAT = 1e-6  # relative change below which a response is the same everywhere
_MINOR = 0.05  # change over the range of the response below which a factor shares one sentence with others
_NOISE = 4.0  # standard errors that the effect of a factor in a sampled design must exceed
_SAMPLED = ("latin-hypercube", "sobol", "saltelli", "morris")
_ROUNDING = 1e-9  # part of the largest value below which a number is called zero
_STRAIGHT = 0.98  # R^2 above which a line is a fair summary
_THROUGH_ZERO = 0.02  # offset of that line over its largest value below which it is a proportion


def find(cube: xr.Dataset) -> list[str]:
    """Sentences on what the cube shows: the dominant order, the effect of every factor, and what did not finish.

    Parameters
    ----------
    cube
        A result cube.

    Returns
    -------
    list of str
        The most important first.
    """
    good, total = int(finished(cube).sum()), int(asked(cube).sum())
    if good == 0:
        return [f"None of {total:,} points finished: {_reasons(cube)}."]
    sentences, shown = [], with_all_on(cube)
    if bool(finished(shown).any()):
        sentences = [_dominant_order(shown)] if "thrust_amplitude" in cube else []
        for response in responses(shown):
            sentences.extend(_effects(response, shown))
    if "attempt" in cube and (changed := int(((cube["attempt"] > 0) & finished(cube)).sum())):
        sentences.append(f"{changed:,} of {total:,} points finished only after a retry.")
    if "accuracy_met" in cube:
        sentences.append(_chosen(cube))
    if good < total:
        failed = f"{total - good:,} of {total:,} points did not finish: {_reasons(cube)}."
        sentences.insert(0 if good < total / 2 else len(sentences), failed)
    return sentences + _notes(cube)


def _notes(cube: xr.Dataset) -> list[str]:
    """State how many finished points have a note, with the first note."""
    if "outcome_detail" not in cube:
        return []
    details = cube["outcome_detail"].values[finished(cube).values]
    noted = details[details != ""]
    told = f"{noted.size:,} points finished with a note (outcome_detail)"
    return [f"{told}, the first: {noted[0]}."] if noted.size else []


def _chosen(cube: xr.Dataset) -> str:
    """State at how many points each model was chosen, and how many will probably miss the accuracy."""
    inside = asked(cube).values
    told = ""
    if "model_used" in cube:
        used = cube["model_used"]
        words = dict(zip(used.attrs.get("flag_values", ()), used.attrs.get("flag_meanings", "").split(), strict=True))
        models, counts = np.unique(used.values[inside], return_counts=True)
        told = ": " + ", ".join(f"{words.get(m, f'{m:g}')} at {n:,}" for m, n in zip(models, counts, strict=True))
    unmet = int((cube["accuracy_met"].values[inside] == 0).sum())
    short = f"; {unmet:,} are not expected to meet the accuracy" if unmet else ""
    return f"The model was chosen for each point{told} of {int(inside.sum()):,} points{short}."


def _reasons(cube: xr.Dataset) -> str:
    outcome = cube["outcome"].values[asked(cube).values]
    counts = {kind: int((outcome == kind).sum()) for kind in Outcome if kind is not Outcome.FINISHED}
    return ", ".join(f"{count:,} {kind.label}" for kind, count in counts.items() if count)


def _dominant_order(cube: xr.Dataset) -> str:
    amplitude = cube["thrust_amplitude"]
    mean = amplitude.mean([dim for dim in amplitude.dims if dim != "order"]).isel(order=slice(1, None))
    first, second = (int(mean["order"].values[i]) for i in np.argsort(mean.values)[::-1][:2])
    if float(mean.sel(order=first)) == 0:
        return "The thrust force has no rotating order: all amplitudes are zero."
    over = " on average over the study" if int(finished(cube).sum()) > 1 else ""
    return (
        f"The {ORDINALS[first]} of the thrust force is the largest: {number(float(mean.sel(order=first)))} N{over}; "
        f"the next is the {ORDINALS[second]} with {number(float(mean.sel(order=second)))} N."
    )


def _effects(response: Response, cube: xr.Dataset) -> Iterator[str]:
    """Yield the range of a response, then one sentence per strong factor and one for all weak factors."""
    values = response.values.values
    values = values[np.isfinite(values)]
    if values.size == 0:
        return
    low, high, largest = float(values.min()), float(values.max()), float(np.abs(values).max())
    name = response.label if response.key == response.label else f"the {response.label}"
    start = name[0].upper() + name[1:] if response.key != response.label else name
    if values.size == 1:
        yield f"{start} is {with_unit(number(high), response.unit)}."
        return
    if high - low <= _FLAT * largest:
        yield f"{start} is the same at all points: {with_unit(number(high), response.unit)}."
        return
    ends = [with_unit(number(_clean(end, largest)), response.unit) for end in (low, high)]
    yield f"{start} lies between {ends[0]} and {ends[1]}."
    effects = {factor: main_effect(response, cube, factor) for factor in numeric_factors(cube)}
    ranked = sorted((f for f in effects if effects[f].mean.size > 1), key=lambda factor: -effects[factor].rise)
    noisy = design_kind(cube) in _SAMPLED
    weak = []
    for factor in ranked:
        effect = effects[factor]
        if effect.rise > max(_MINOR * (high - low), _NOISE * effect.standard_error if noisy else 0.0):
            yield _sentence(name, start, response.unit, cube, factor, effect)
        else:
            weak.append(factor)
    if weak:
        part = 100 * max(effects[factor].rise for factor in weak) / (high - low)
        labels = listed([factor_label(cube, factor) for factor in weak])
        yield f"{labels[0].upper() if start != name else labels[0]}{labels[1:]} " + (
            f"{'change' if len(weak) > 1 else 'changes'} {name} by at most {_rounded_up(part)} % of that range"
            f"{_others(cube, ', ', weak[0] if len(weak) == 1 else '')}."
        )


def _clean(value: float, largest: float) -> float:
    """Replace values within rounding error by zero."""
    return 0.0 if abs(value) < _ROUNDING * largest else value


def _rounded_up(percent: float) -> str:
    """One digit, rounded up, so that "at most" holds."""
    digit = 10.0 ** math.floor(math.log10(percent)) if percent > 0 else 1.0
    return f"{math.ceil(percent / min(digit, 1.0)) * min(digit, 1.0):.2g}"


def _others(cube: xr.Dataset, before: str, factor: str = "") -> str:
    """State how the other factors are treated in a statement about one: at base values, or averaged."""
    others = [name for name in factor_names(cube) if name != factor and np.unique(cube[name].values).size > 1]
    if not others:
        return ""
    if "varied" in cube.coords:
        return f"{before}others at their base values"
    return f"{before}averaged over {factor_label(cube, others[0]) if len(others) == 1 else 'the other factors'}"


def _sentence(name: str, start: str, unit: str, cube: xr.Dataset, factor: str, effect: Effect) -> str:
    """State how the response depends on one factor: proportional, linear, or by its smallest and largest mean."""
    levels, curve = effect.level, effect.mean
    label, own = factor_label(cube, factor), factor_unit(cube, factor)
    slope, offset = np.polyfit(levels, curve, 1)
    residual = curve - (slope * levels + offset)
    straight = 1 - float(residual @ residual) / max(float(((curve - curve.mean()) ** 2).sum()), 1e-300)
    if straight >= _STRAIGHT and levels.size > 2:
        # Without a unit "per 1" is far outside the range of a friction coefficient: say it per 0.01, for instance.
        step = 1.0 if own else 10.0 ** math.floor(math.log10(float(np.ptp(levels))))
        per = f"{with_unit(number(abs(slope) * step), unit)} per {own or number(step)}"
        ends = [f"{float(end):.3g}" for end in (cube[factor].min(), cube[factor].max())]
        where = with_unit(f"{ends[0]} to {ends[1]}", own) + _others(cube, ", ", factor)
        if abs(offset) <= _THROUGH_ZERO * np.abs(curve).max():
            return f"{start} is proportional to {label}: {per} ({where}; R2 = {straight:.4f})."
        verb = "increases" if slope > 0 else "decreases"
        return f"{start} {verb} with {label} by {per} ({where}; straight line with R2 = {straight:.4f})."
    largest = float(np.abs(curve).max())
    least, most = (
        f"{with_unit(number(_clean(float(curve[at]), largest)), unit)} (at {with_unit(number(levels[at]), own)})"
        for at in (int(np.argmin(curve)), int(np.argmax(curve)))
    )
    return f"Over the {label}, {name} ranges from {least} to {most}{_others(cube, ', ', factor)}."

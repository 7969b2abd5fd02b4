"""Findings of a sensitivity analysis: its strongest factors, what is not resolved, whether the points are enough."""

import math

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.sensitivity import RANKED
from tripod_doe.analyses.sensitivity.method import without_interval
from tripod_doe.number_text import interval, number, rounded_up
from tripod_doe.page_parts.main_outputs import OutputPart, left_points, main_outputs
from tripod_doe.page_parts.words import listed, spoken

_MOST_NAMED = 4  # factors that a sentence names
_NOT_RESOLVED, _BELOW_ERROR = 0, 2  # flags of `resolved`
_HEADS = {
    "fast": "Total Sobol' indices (FAST) of {what}",
    "rbd-fast": "First-order Sobol' indices (RBD-FAST) of {what}",
    "pawn": "PAWN indices of {what}",
    "delta": "Borgonovo's delta of {what}",
    "dgsm": "Upper bounds of the total Sobol' indices of {what}, from derivatives",
    "shapley": "Shapley effects on {what}, as parts of its variance",
}


def find_in_sensitivity(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on the strongest factors of each main output, then on the points and on what failed."""
    kind = kind_of(result)
    sentences = []
    parts = sensitivity_parts(result)
    if kind == "dgsm" and (jumps := _without_bound(result)):
        which = "an output, which jumps" if jumps == 1 else f"{jumps} outputs or parts of them, which jump"
        sentences.append(f"No bounds are stated for {which}: small steps do not show the variance (analysis {name}).")
    elif RANKED[kind] in result and not parts:
        sentences.append(nothing_varies(name))
    for part in parts:
        match kind:
            case "sobol":
                text = sobol_sentence(part)
            case "morris":
                text = _morris_sentence(part)
            case _:
                text = _index_sentence(part, kind)
        sentences += [f"{text} (analysis {name}).", *_unresolved(part), *_without_interval(part, kind, result)]
        sentences += _convergence(part, kind, result)
    return sentences + left_points(result)


def nothing_varies(name: str, what: str = "factor has an index") -> str:
    """That an analysis has nothing to share out."""
    return f"The main outputs are the same at all points: no {what} (analysis {name})."


def _without_bound(result: xr.Dataset) -> int:
    """How many components have derivatives and no bounds."""
    keys = [str(key) for key in result.data_vars if str(key).endswith("dgsm")]
    return sum(int((result[key].isnull() & result[f"{key[:-4]}vi"].notnull()).any("factor").sum()) for key in keys)


def sensitivity_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their indices over ``factor`` alone."""
    key = RANKED[kind_of(result)]
    if key not in result:
        return []
    return main_outputs(_with_halves(result), key, ("factor",))


def _with_halves(result: xr.Dataset) -> xr.Dataset:
    """A result with half widths of all indices, NaN for a method that knows no intervals."""
    ranked = RANKED[kind_of(result)]
    keys = dict.fromkeys(("S1", "ST", ranked, f"{ranked}_over_samples"))
    without = [key for key in keys if key in result and f"{key}_conf" not in result]
    return result.assign({f"{key}_conf": xr.full_like(result[key], np.nan) for key in without})


def sobol_sentence(part: OutputPart) -> str:
    """The strongest total indices of an output, and whether interactions show."""
    ranked = _ranked(part.answers, "ST")
    shown = [row for row in ranked[:_MOST_NAMED] if not row[1] <= row[2]] or ranked[:1]
    text = listed([f"{spoken(factor)} {interval(value, half)}" for factor, value, half in shown])
    rest = [value + half for _, value, half in ranked[len(shown) :]]
    others = f"; all others at most {rounded_up(max(rest))}" if rest and np.isfinite(rest).all() else ""
    first = {index: part.answers[index].values[np.isfinite(part.answers["S1"].values)] for index in ("S1", "S1_conf")}
    total, half = float(first["S1"].sum()), float(np.sqrt((first["S1_conf"] ** 2).sum()))
    alone = f"the first-order indices add up to {interval(total, half)}: {_interactions(total, half)}"
    return f"Total Sobol' indices of {part.what}: {text}{others}; {alone}"


def _interactions(first: float, half: float) -> str:
    """What the sum of the first-order indices and its half width say of interactions."""
    if not np.isfinite(first + half):
        return "what interactions explain is not known"
    if first + half < 0.99:
        return f"interactions explain at least {math.floor(100 * (1 - first - half))} % of the variance"
    most = rounded_up(100 * max(1 - (first - half), 0.0))
    return f"interactions may explain up to {most} % of the variance" if most != "0" else "interactions explain nothing"


def _morris_sentence(part: OutputPart) -> str:
    text = [f"{spoken(factor)} {interval(value, half)}" for factor, value, half in _ranked(part.answers, "mu_star")]
    return (
        f"Largest mean elementary effects on {part.what}, in its unit over the whole range of a factor: "
        f"{listed(text[:_MOST_NAMED])}"
    )


def _index_sentence(part: OutputPart, kind: str) -> str:
    ranked = _ranked(part.answers, RANKED[kind])
    text = [_index_text(row, kind) for row in ranked[:_MOST_NAMED]]
    chance = ""
    if "chance" in part.answers:
        chance = f"; factors without effect reach {number(float(part.answers['chance']), 2)} by chance"
    return f"{_HEADS[kind].format(what=part.what)}: {listed(text)}{chance}"


def _index_text(row: tuple[str, float, float], kind: str) -> str:
    """A factor with its index; of an upper bound above one, that it bounds nothing."""
    factor, value, half = row
    known = kind != "dgsm" or value < 1
    return f"{spoken(factor)} {interval(value, half) if known else 'not below 1'}"


def _unresolved(part: OutputPart) -> list[str]:
    """Factors whose interval covers zero, and those whose effect is below the numerical error of the model."""
    if "resolved" not in part.answers:
        return []
    flags = dict(zip(map(str, part.answers["factor"].values), part.answers["resolved"].values, strict=True))
    sentences = []
    if names := [spoken(factor) for factor, flag in flags.items() if flag == _NOT_RESOLVED]:
        sentences.append(
            f"Not resolved for {part.what}: {'effects' if len(names) > 1 else 'effect'} of {listed(names)}."
        )
    if names := [spoken(factor) for factor, flag in flags.items() if flag == _BELOW_ERROR]:
        one = "is smaller than the numerical error of the model, and it is not ranked"
        many = "are smaller than the numerical error of the model, and they are not ranked"
        effects = f"the effect of {names[0]} {one}" if len(names) == 1 else f"the effects of {listed(names)} {many}"
        sentences.append(f"For {part.what}, {effects}.")
    return sentences


def _without_interval(part: OutputPart, kind: str, result: xr.Dataset) -> list[str]:
    """Factors without an interval: whose effects vary in too few trajectories, or all where few blocks decide."""
    ranked, answers = RANKED[kind], part.answers
    if f"{ranked}_conf" not in result:
        return []
    missing = without_interval(answers[ranked].values, answers[f"{ranked}_conf"].values)
    names = [spoken(str(factor)) for factor in answers["factor"].values[missing]]
    if not names:
        return []
    if kind != "morris":
        return [without_intervals(part.what)]
    blocks = int(result.attrs["groups_used"])
    each = "the effect" if len(names) == 1 else "the effects"
    return [
        f"No interval is known for {each} of {listed(names)} on {part.what}: "
        f"{'it is' if len(names) == 1 else 'each is'} the same in all or nearly all of the {blocks:,} trajectories."
    ]


def without_intervals(what: str) -> str:
    """Why an output has no intervals."""
    return f"No intervals are known for {what}: too few samples make up its variance."


def _convergence(part: OutputPart, kind: str, result: xr.Dataset) -> list[str]:
    """Whether there are enough points for the requested precision, or about how many would be enough."""
    if "samples_needed" not in part.answers or not np.isfinite(part.answers["samples_needed"]):
        return []
    used, needed = int(result.attrs["groups_used"]), int(part.answers["samples_needed"])
    asked = f"+-{100 * float(result.attrs['precision']):g} % of the largest index"
    thing = {"morris": "trajectories", "sobol": "samples"}.get(
        kind, "points" if result.attrs["block_size"] == 1 else "blocks"
    )
    if needed <= used:
        return [f"{used:,} {thing} are enough for {part.what}: all intervals are within {asked}."]
    return [f"{used:,} {thing} are not enough for {part.what}: intervals within {asked} need about {needed:,}."]


def _ranked(part: xr.Dataset, key: str) -> list[tuple[str, float, float]]:
    """Factor, index and half width of its interval, the largest first; without those below the model's error."""
    rows = list(zip(part["factor"].values, part[key].values, part[f"{key}_conf"].values, strict=True))
    above = [True] * len(rows)
    if "resolved" in part and (part["resolved"].values != _BELOW_ERROR).any():
        above = list(part["resolved"].values != _BELOW_ERROR)
    chosen = (row for row, text in zip(rows, above, strict=True) if text)
    return sorted(((str(f), float(v), float(c)) for f, v, c in chosen if np.isfinite(v)), key=lambda row: -row[1])

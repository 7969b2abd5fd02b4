"""Contribution of the mechanisms in sentences: who makes an amplitude, who opposes it, and what the shares mean."""

import math

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.contribution.contribution import PAPER_SHARES
from tripod_doe.analyses.contribution.share_tables import (
    ANSWERS,
    CHANGES,
    DEFINITIONS,
    Contribution,
    at_each,
    contributions,
    percent,
    signed,
    spread,
    stated_over,
)
from tripod_doe.array_types import FloatArray
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.number_text import count_of
from tripod_doe.page_parts.words import listed, spoken

_PRINTED = 0.05  # percent that still shows in the one digit after the point
_AGREE = 4.0  # percentage points within which two shares count as agreeing
_ALL_OF_IT = 0.5  # percent within which a share by switching off counts as the whole
_HALF = 1.0  # percentage points within which a Shapley value counts as half of the share by switching off
_MOST_LOST = 3  # operating points whose missing combinations are named
_FEW = 4  # up to this number, each operating point has a row in the table, and none is singled out
_REMOTE = 5.0  # percentage points from the median above which a share at one point gets a sentence


def find_in_contribution(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on a contribution analysis: the shares of the third and the second order, and models mixed in them."""
    shares = [sentence for part in contributions({name: result}) for sentence in contribution_findings(part)]
    if not (mixed := int(result.attrs.get("points_of_several_models", 0))):
        return shares
    many = math.prod(result.sizes[dim] for dim in str(result.attrs.get("operating_dims", "")).split())
    of = f"{mixed:,} of {count_of(many, 'operating point')}"
    return [
        *shares,
        f"At {of} the combinations of mechanisms have several models ({result.attrs['models']}): shares and changes "
        f"there hold what these models differ by, too (analysis {name}).",
    ]


def contribution_findings(part: Contribution) -> list[str]:
    """State the shares, who opposes the sum, the most unusual operating point, and what is closest to the paper."""
    if part.missing:
        return [f"{_capitalised(part.what)} has no shares: {part.missing} (analysis {part.analysis})."]
    return [
        *_changes(part),
        *(_who_makes_it(part, side, rows) for side, rows in part.sides.items() if _counted(part)[rows].any()),
        *_points_without_shares(part),
        *_uncertain(part),
        *_furthest(part),
        *_nearest_to_paper(part),
    ]


def contribution_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]] | None:
    """A row with amplitude, shares and change for each operating point, if these are few; else None."""
    heads: list[str] = []
    rows = []
    for part in contributions({"": result}):
        if part.missing or not 1 < len(part.labels) <= _FEW:
            continue
        change = next((key for key in CHANGES if key in part.changes), "")
        meaning = {"change_halved": "with half of it", "change_off": "without it"}.get(change, "")
        heads = ["of", "operating point", "amplitude", *(f"{spoken(name)}: share" for name in part.mechanisms)]
        heads += [f"{spoken(name)}: change {meaning}" for name in part.mechanisms] if change else []
        for at, label in enumerate(part.labels):
            shares = [percent(part.shares[part.leading][at : at + 1, k]) for k in range(len(part.mechanisms))]
            changes = part.changes[change][at] if change else np.empty(0)
            rows.append([part.what, label, part.amplitudes[at], *shares, *(signed(np.array([c])) for c in changes)])
    return (heads, rows) if rows else None


def contribution_notes(part: Contribution) -> list[str]:
    """Notes on the shares: mechanisms on which all of the amplitude depends, and the strongest interaction."""
    if part.missing:
        return contribution_findings(part)
    return _all_passes(part) + _strongest_interaction(part) + _agreement(part) + _lost_combinations(part)


def _lost_combinations(part: Contribution) -> list[str]:
    """Name, at the first points, the combinations without a result and the remaining bounds of Shapley values."""
    places = [at for at, text in enumerate(part.lost) if text]
    sentences = []
    for at in places[:_MOST_LOST]:
        where = f"At {part.labels[at]}, there" if part.labels[at] else "There"
        names = listed([" + ".join(map(spoken, text.split(" + "))) for text in part.lost[at].split("; ")])
        sentence = f"{where} is no result with only these mechanisms on: {names}"
        if part.shapley_bounds is not None and np.isfinite(part.shapley_bounds[0][at]).all():
            ends = zip(part.mechanisms, *(end[at] for end in part.shapley_bounds), strict=True)
            values = [f"{spoken(name)} {percent(np.array([low, high]))}" for name, low, high in ends]
            sentence += (
                ". Shapley values lie within these bounds if the missing results lie between the smallest and the "
                f"largest known one: {', '.join(values)}"
            )
        sentences.append(f"{sentence}.")
    if more := len(places) - len(sentences):
        sentences.append(f"Combinations are missing at {more:,} more operating point{'s' * (more > 1)}.")
    return sentences


def _capitalised(text: str) -> str:
    return text[0].upper() + text[1:] if text.startswith("the ") else text  # a name of a user stays as it is


def _changes(part: Contribution) -> list[str]:
    """What happens to the amplitude with less of one friction, drive and coast: the question of a designer."""
    key = next((key for key in CHANGES if key in part.changes), "")
    if not key or not np.isfinite(part.changes[key]).any():
        return []
    counted = part.counted(part.changes[key])
    sides = {side: rows & counted for side, rows in part.sides.items() if (rows & counted).any()}
    known = {side: part.changes[key][rows] for side, rows in sides.items()}
    size = np.array([np.nanmax(np.abs(column), initial=0.0) for column in part.changes[key].T])
    text = []
    for at in np.argsort(-size, kind="stable"):
        values = [f"{at_each(values[:, at], signed)}{f' ({side})' if side else ''}" for side, values in known.items()]
        text.append(f"{spoken(part.mechanisms[at])} {' and '.join(values)}")
    one = "friction" if set(part.mechanisms) <= set(MECHANISMS) else "mechanism"  # a function has names of its own
    what = {"change_halved": f"half of one {one} alone", "change_off": f"one {one} alone switched off"}[key]
    over = {side: stated_over(part, rows, known[side]) for side, rows in sides.items()}
    each = ", ".join(f"{side} {text}".lstrip() for side, text in over.items() if text)
    many = f"; {each}" if each else ""
    whole = f" ({part.amplitude})" if part.amplitude else ""
    return [f"With {what}, {part.what}{whole} changes by: {', '.join(text)}{many} (analysis {part.analysis})."]


def _who_makes_it(part: Contribution, side: str, rows: NDArray[np.bool_]) -> str:
    """The shares at the operating points of drive or of coast, where friction may help, or at all of them."""
    leading = part.leading
    rows = rows & _counted(part)
    values = part.shares[leading][rows]
    known = np.isfinite(values).any(axis=0)
    median = np.where(known, np.nanmedian(np.where(known, values, 0.0), axis=0), np.nan)
    ranked = [int(at) for at in np.argsort(-np.nan_to_num(median), kind="stable")]
    opposing = (np.nanmax(np.where(known, values, 0.0), axis=0) < -_PRINTED) & known  # wherever it is known
    text = [f"{spoken(part.mechanisms[at])} {at_each(values[:, at], percent)}" for at in ranked if not opposing[at]]
    against = [f"{spoken(part.mechanisms[at])} with {at_each(values[:, at], percent)}" for at in ranked if opposing[at]]
    opposed = [f"{listed(against)} oppose{'s' if len(against) == 1 else ''} the sum"] * bool(against)
    closure = ""
    if leading == "share_off" and spread(part.closure[rows]):
        closure = f"; they add up to {at_each(100 - part.closure[rows], percent)}"
    remainder = 100 - values.sum(axis=1)
    if leading == "share_direct" and np.abs(remainder).max() > _PRINTED:
        closure = f"; {at_each(remainder, percent)} is {_rest_meaning(part)}"
    points = stated_over(part, rows, values)
    over = f", {points}" if points else ""
    size = f" ({part.amplitude})" if part.amplitude and not side else ""
    return (
        f"Of {part.what}{size}{f' in {side}' if side else ''}, by {DEFINITIONS[leading]} ({ANSWERS[leading]}){over}: "
        f"{'; '.join([*filter(None, [', '.join(text)]), *opposed])}{closure} (analysis {part.analysis})."
    )


def _counted(part: Contribution) -> NDArray[np.bool_]:
    """The operating points that statements on shares count."""
    return part.counted(part.shares[part.leading])


def _rest_meaning(part: Contribution) -> str:
    """What the rest of a direct decomposition is; a study may switch some of the mechanisms alone."""
    if set(part.mechanisms) >= set(MECHANISMS):
        return "not due to friction (inertia, numerical error)"
    return "due to the rest: mechanisms that this study does not switch, inertia, numerical error"


def _points_without_shares(part: Contribution) -> list[str]:
    """Count the operating points without shares, by reason."""
    lost, why = ~part.shared & ~part.zero, "since points that they need did not finish or have no value"
    partly = part.shared & ~_counted(part)
    reasons = {
        f"{part.what} is zero within its numerical error, and has no shares": int(part.zero.sum()),
        f"{part.what} has no shares, {why}": int(lost.sum()),
        f"{part.what} lacks some shares by {DEFINITIONS[part.leading]}, {why}; none there is counted": int(
            partly.sum()
        ),
    }
    of = f"{len(part.labels):,} operating points"
    return [f"At {count:,} of {of} {reason}." for reason, count in reasons.items() if count]


def _uncertain(part: Contribution) -> list[str]:
    """Flag the operating points at which the amplitude is small compared with its error."""
    count = int(part.uncertain.sum())
    if count == 0:
        return []
    if len(part.labels) == 1:
        return [f"These shares are uncertain: the numerical error of {part.what} exceeds 5 % of it."]
    of = f"{count:,} of {len(part.labels):,} operating points"
    return [f"At {of} the numerical error of {part.what} exceeds 5 % of it, so its shares there are uncertain."]


def _furthest(part: Contribution) -> list[str]:
    """The operating point at which a share is furthest from its median, if it is far."""
    values = part.shares[part.leading]
    if not any(np.isfinite(values[rows]).all(axis=1).sum() > _FEW for rows in part.sides.values()):
        return []
    usual = np.full_like(values, np.nan)  # medians, separate for drive and coast
    for rows in part.sides.values():
        own = values[rows & _counted(part)]
        if len(own):
            usual[rows] = np.nanmedian(np.where(np.isfinite(own).any(axis=0), own, 0.0), axis=0)
    away = np.abs(values - usual)
    at, which = np.unravel_index(int(np.nanargmax(away)), away.shape)
    if not away[at, which] > _REMOTE or not part.labels[at]:
        return []
    median = percent(usual[at : at + 1, which])
    side = next(f" in {side}" if side else "" for side, rows in part.sides.items() if rows[at])
    return [
        f"The share of {spoken(part.mechanisms[which])} in {part.what} differs most from its median at "
        f"{part.labels[at]}: {percent(values[at : at + 1, which])}, with a median{side} of {median}."
    ]


def _nearest_to_paper(part: Contribution) -> list[str]:
    differences = part.differences()
    if not differences:
        return []
    nearest = min(differences, key=lambda name: differences[name])
    others = [f"{DEFINITIONS[name]}: {value:.1f}" for name, value in differences.items() if name != nearest]
    text = f" ({', '.join(others)})" if others else ""
    at = [label for label, is_there in zip(part.labels, part.like_paper, strict=True) if is_there]
    where = f", at {'; '.join(at)}," if any(at) else ""
    printed = ", ".join(f"{spoken(name)} {share:.0f} %" for name, share in PAPER_SHARES.items())
    return [
        f"The paper's shares of {part.what} ({printed}) are{where} closest to those by {DEFINITIONS[nearest]}: the "
        f"largest difference is {differences[nearest]:.1f} percentage points{text}."
    ]


def _all_passes(part: Contribution) -> list[str]:
    """A note if the whole amplitude depends on one mechanism: the consequence for each definition."""
    whole = np.nan_to_num(np.abs(part.shares["share_off"] - 100), nan=np.inf).max(axis=0) < _ALL_OF_IT
    needed = np.flatnonzero(whole)
    names = [spoken(part.mechanisms[at]) for at in needed]
    if needed.size == 1:
        left = f"without it, less than {_ALL_OF_IT:g} % is left in the same phase"
        return [f"All of {part.what} depends on {names[0]}: {left}.{_halves(part, int(needed[0]))}"]
    if needed.size == 0:
        return []
    alone = np.abs(np.nan_to_num(part.shares["share_on"][:, needed], nan=np.inf)).max() < _ALL_OF_IT
    clauses = [f"switching off any of them leaves less than {_ALL_OF_IT:g} %"]
    clauses += [f"each alone contributes less than {_ALL_OF_IT:g} %"] * bool(alone)
    shapley = part.shares.get("share_shapley", np.full_like(part.shares["share_off"], np.nan))[:, needed]
    if np.isfinite(shapley).all() and np.ptp(shapley, axis=1).max() < _ALL_OF_IT:
        clauses.append("their Shapley values are equal")
    return [f"{_capitalised(part.what)} needs {listed(names)} together: {', '.join(clauses)}."]


def _halves(part: Contribution, needed: int) -> str:
    """Why the other mechanisms' Shapley values are half of their shares by switching off, if they are."""
    if "share_shapley" not in part.shares:
        return ""
    others = np.arange(len(part.mechanisms)) != needed
    half = part.shares["share_off"][:, others] / 2
    gap = np.abs(part.shares["share_shapley"][:, others] - half)
    if not np.isfinite(gap).all() or gap.max(initial=0) > _HALF or np.abs(half).max(initial=0) <= _HALF:
        return ""
    return (
        " The Shapley value divides a joint contribution of two mechanisms equally between them, so the others "
        "get about half of their shares by switching off."
    )


def _strongest_interaction(part: Contribution) -> list[str]:
    if not np.isfinite(part.interaction).any():
        return []
    strongest = int(np.nanargmax(np.abs(part.interaction)))
    pair = " and ".join(spoken(name) for name in part.pairs[strongest].split(" + "))
    size = float(part.interaction[strongest])
    if abs(size) < _PRINTED:
        return [f"No two mechanisms interact in {part.what} (Shapley interaction indices below {_PRINTED:g} %)."]
    at = f", at {part.labels[strongest]}" if part.labels[strongest] else ""
    return [
        f"The strongest interaction in {part.what} is between {pair}: together they contribute {abs(size):.1f} "
        f"percentage points {'more' if size > 0 else 'less'} than separately (Shapley interaction index{at})."
    ]


def _agreement(part: Contribution) -> list[str]:
    """State where the direct decomposition agrees with the ablation, and why it may differ."""
    direct = part.shares.get("share_direct")
    if direct is None or not np.isfinite(direct).any():
        return []
    text = [
        f"{meaning} {compared}"
        for name, meaning in DEFINITIONS.items()
        if name in part.shares and name != "share_direct"
        if (compared := _agreeing_mechanisms(part.mechanisms, direct, part.shares[name]))
    ]
    rest = percent(100 - direct.sum(axis=1))
    compared = (
        f" Within {_AGREE:.0f} percentage points {'; '.join(text)}. They need not agree: with a mechanism off, the "
        "motion and the directions of the friction forces change; the decomposition keeps the motion with all on."
    )
    return [
        f"Direct decomposition of {part.what}: what each mechanism's force adds at the grooves while all are on. It "
        f"leaves {rest} to inertia, numerical error and mechanisms that are not switched here."
        f"{compared if text else ''}"
    ]


def _agreeing_mechanisms(mechanisms: list[str], direct: FloatArray, values: FloatArray) -> str:
    """For which mechanisms another definition gives the share by direct decomposition; empty if none is known."""
    gaps = np.abs(values - direct)
    known = [at for at in range(len(mechanisms)) if np.isfinite(gaps[:, at]).any()]
    same = [spoken(mechanisms[at]) for at in known if np.nanmax(gaps[:, at]) <= _AGREE]
    apart = [
        f"{spoken(mechanisms[at])} (direct {percent(direct[:, at])}, there {percent(values[:, at])})"
        for at in known
        if np.nanmax(gaps[:, at]) > _AGREE
    ]
    if not known:
        return ""
    if not apart:
        return "agrees for all" if len(known) == len(mechanisms) else f"agrees for {listed(same)}"
    return f"agrees for {listed(same) if same else 'none'}, not for {', '.join(apart)}"

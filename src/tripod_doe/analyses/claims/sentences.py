"""The claims of the paper in sentences and as tables, for one skew and over the chosen skews."""

import math
import re
from collections.abc import Mapping

import numpy as np
import xarray as xr

from tripod_doe.analyses.claims.verdicts import Verdict
from tripod_doe.number_text import capital, digits_apart, level, number, text_range, with_unit
from tripod_doe.page_parts.words import listed, unit_text

_HEADS = ["Claim", "Holds", "Value", "Holds if", "In the paper", "Quantity"]
_FIGURES = re.compile(r"\bFigs?\. (\d+(?:\([a-z]\))?(?:(?:,| and|, and| to) \d+(?:\([a-z]\))?)*)")


def find_in_claims(claims: xr.Dataset, name: str = "") -> list[str]:
    """Number of claims that hold, then the others, each with its reason."""
    verdicts = claims["verdict"].values
    counts = {verdict: int((verdicts == verdict).sum()) for verdict in Verdict}
    sentences = [
        f"Of {verdicts.size} claims of the paper {counts[Verdict.HOLDS]} hold with model {claims.attrs['model']}, "
        f"{counts[Verdict.DOES_NOT_HOLD]} do not, and {counts[Verdict.NOT_DECIDED]} are not decided. Skews: "
        f"{claims.attrs['cases']}."
    ]
    for verdict in (Verdict.DOES_NOT_HOLD, Verdict.NOT_DECIDED):
        for at in np.flatnonzero(verdicts == verdict):
            row = claims.isel(claim=int(at))
            seen = f" ({claim_value(row)}; required: {claim_limits(row)})" if verdict is Verdict.DOES_NOT_HOLD else ""
            text = row["reason"].item()
            sentences.append(
                f"{verdict.label.capitalize()}: {row['statement'].item()}, {row['place'].item()}{seen}. {capital(text)}"
            )
    return sentences


def claim_table(claims: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Heads and one row per claim, in the order of the paper; reasons are in the sentences and in claims.json."""
    words = {Verdict.HOLDS: "yes", Verdict.DOES_NOT_HOLD: "no", Verdict.NOT_DECIDED: "not decided"}
    rows = []
    for at in range(claims.sizes["claim"]):
        row = claims.isel(claim=at)
        verdict = Verdict(int(row["verdict"]))
        near = "" if row["sure"].item() or verdict is Verdict.NOT_DECIDED else ", but within the numerical error"
        rows.append(
            [
                row["statement"].item(),
                words[verdict] + near,
                claim_value(row),
                claim_limits(row),
                row["place"].item(),
                row["quantity"].item(),
            ]
        )
    return list(_HEADS), rows


def _figure_numbers(text: str) -> set[int]:
    """The figures that a text names: "Figs. 10, 15 and 18" or "3.2, Fig. 10; 3.3, Fig. 13"; "16 to 18" are three."""
    numbers: set[int] = set()
    for figures in _FIGURES.findall(text):
        parts = [int(number) for number in re.findall(r"\d+", figures)]
        numbers |= set(range(parts[0], parts[-1] + 1)) if " to " in figures else set(parts)
    return numbers


def figures_of_claims(claims: xr.Dataset, figures: Mapping[str, str]) -> list[list[tuple[str, str]]]:
    """Links from each claim to the figures of its place in the paper: (text, address), one list per claim.

    Args:
        figures: Headings of the figures, such as "Fig. 13: orders", by their addresses.
    """
    shown = {number: address for address, title in figures.items() for number in sorted(_figure_numbers(title))}
    return [
        [(f"Fig. {number}", shown[number]) for number in sorted(_figure_numbers(str(place))) if number in shown]
        for place in claims["place"].values
    ]


def claims_of_figures(claims: xr.Dataset, title: str) -> tuple[list[str], list[list[str]]] | None:
    """The table of the claims that belong to a figure named in a title; None if there are none."""
    named = _figure_numbers(title)
    chosen = [at for at, place in enumerate(claims["place"].values) if _figure_numbers(str(place)) & named]
    return claim_table(claims.isel(claim=chosen)) if chosen else None


def claim_value(row: xr.Dataset) -> str:
    """The number that decides a claim, with its numerical error and unit, in digits that differ from its limits."""
    value, error = float(row["value"]), float(row["error"])
    if not math.isfinite(value):
        return "unknown"
    unsure = math.isfinite(error) and error > 0
    limits = [float(row[end]) for end in ("low", "high")]
    digits = [6 if abs(value - 1) < 1e-2 else 3, *(digits_apart(value, limit) for limit in limits if limit != value)]
    if unsure and value:
        digits.append(math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1)
    spread = f" +- {number(error, 2)}" if unsure else ""
    return with_unit(number(value, max(digits)) + spread, unit_text(str(row["unit"].item())))


def claim_limits(row: xr.Dataset) -> str:
    """The limits within which a claim holds."""
    low, high = float(row["low"]), float(row["high"])
    unit = unit_text(str(row["unit"].item()))
    if math.isfinite(low) and math.isfinite(high):
        return text_range(level(low), level(high), unit)
    return with_unit(f"at least {level(low)}" if math.isfinite(low) else f"at most {level(high)}", unit)


_WORDS = {Verdict.HOLDS: "yes", Verdict.DOES_NOT_HOLD: "no", Verdict.NOT_DECIDED: "not decided"}


def find_over_skew(claims: xr.Dataset, name: str = "") -> list[str]:
    """State which claims hold for all chosen skews, which for no skew, and which only for some."""
    skews = claims["skew_deg"].values
    groups: dict[bool, list[str]] = {True: [], False: []}
    sentences = []
    for at in range(claims.sizes["claim"]):
        row = claims.isel(claim=at)
        known = row["verdict"].values != Verdict.NOT_DECIDED
        holds = row["verdict"].values[known] == Verdict.HOLDS
        what = f"{row['statement'].item()} ({row['place'].item()})"
        if holds.all() or not holds.any():
            groups[bool(holds.all())].append(what)
        else:
            sentences.append(
                f"Depends on the skew: {what}. It holds at {listed(list(map(level, skews[known][holds])))} deg; "
                f"{row['quantity'].item()}: {_ends_text(row, known)}."
            )
    ends = text_range(level(skews.min()), level(skews.max()), "deg")
    decided = bool((claims["verdict"].values != Verdict.NOT_DECIDED).all())
    first = (
        f"The paper does not print its skews. With {ends} in cases 2 to 4, and half of that in case 1, "
        f"{len(groups[True])} of {claims.sizes['claim']} claims hold at every skew"
        f"{'' if decided else ' at which they are decided'}, {len(groups[False])} at none, and {len(sentences)} "
        f"depend on it (model {claims.attrs['model']})."
    )
    text = [
        f"Claims that hold at {which} skew: {'; '.join(groups[held])}."
        for which, held in (("every", True), ("no", False))
        if groups[held]
    ]
    return [first, *sentences, *text]


def _ends_text(row: xr.Dataset, known: np.ndarray) -> str:
    """The value at the least and at the greatest skew."""
    places = np.flatnonzero(known)
    ends = [row.isel(skew_deg=int(at)) for at in (places[0], places[-1])]
    return " and ".join(f"{claim_value(end)} at {level(float(end['skew_deg']))} deg" for end in ends)


def over_skew_table(claims: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Heads and one row per claim: whether it holds and its value, one column per choice of the skews."""
    rows = []
    for at in range(claims.sizes["claim"]):
        row = claims.isel(claim=at)
        cells = [row.isel(skew_deg=which) for which in range(claims.sizes["skew_deg"])]
        verdicts = [Verdict(int(cell["verdict"])) for cell in cells]
        rows.append(
            [
                row["statement"].item(),
                *(
                    _WORDS[verdict] + ("" if verdict is Verdict.NOT_DECIDED else f": {claim_value(cell)}")
                    for verdict, cell in zip(verdicts, cells, strict=True)
                ),
                claim_limits(row),
            ]
        )
    return ["Claim", *(f"{level(skew)} deg" for skew in claims["skew_deg"].values), "Holds if"], rows

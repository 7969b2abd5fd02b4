"""The paper's claims over the chosen skews, in sentences and as a table."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.analyses.claims.sentences import claim_limits, claim_value
from tripod_doe.analyses.claims.verdicts import Verdict
from tripod_doe.quantities import level

_WORDS = {Verdict.HOLDS: "yes", Verdict.DOES_NOT_HOLD: "no", Verdict.NOT_DECIDED: "not decided"}


def find_over_skew(claims: xr.Dataset) -> list[str]:
    """State which claims hold for all chosen skews, which for none, and which only for some."""
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
                f"Depends on the skew: {what}. It holds at {_listed(skews[known][holds])} deg; "
                f"{row['quantity'].item()}: {_course(row, known)}."
            )
    ends = f"{level(skews.min())} to {level(skews.max())} deg"
    decided = bool((claims["verdict"].values != Verdict.NOT_DECIDED).all())
    first = (
        f"The paper does not print its skews. With {ends} in cases 2 to 4, and half of that in case 1, "
        f"{len(groups[True])} of {claims.sizes['claim']} claims hold at every skew"
        f"{'' if decided else ' at which they are decided'}, {len(groups[False])} at none, and {len(sentences)} "
        f"depend on it (model {claims.attrs['model']})."
    )
    told = [
        f"Claims that hold at {which} skew: {'; '.join(groups[held])}."
        for which, held in (("every", True), ("no", False))
        if groups[held]
    ]
    return [first, *sentences, *told]


def _course(row: xr.Dataset, known: np.ndarray) -> str:
    """The value at the least and at the greatest skew."""
    places = np.flatnonzero(known)
    ends = [row.isel(skew_deg=int(at)) for at in (places[0], places[-1])]
    return " and ".join(f"{claim_value(end)} at {level(float(end['skew_deg']))} deg" for end in ends)


def _listed(values: np.ndarray) -> str:
    told = [level(value) for value in values]
    return told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"


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

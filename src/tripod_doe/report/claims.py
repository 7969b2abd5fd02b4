"""The claims of the paper told in sentences and as a table."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from tripod_doe.analysis.claims import Verdict
from tripod_doe.report.responses import number, unit_text, with_unit

__all__ = ["claim_table", "find_in_claims", "is_claims"]

_HEADS = ["Claim", "In the paper", "Holds", "Value", "Holds if", "Decided by"]


def is_claims(data: xr.Dataset) -> bool:
    """Whether this is a table of claims."""
    return "verdict" in data and "statement" in data


def find_in_claims(claims: xr.Dataset) -> list[str]:
    """How many claims hold, then those that do not and those that are not decided, each with its reason."""
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
            seen = f" ({_value(row)}; it needs {_limits(row)})" if verdict is Verdict.DOES_NOT_HOLD else ""
            told = row["reason"].item()
            sentences.append(
                f"{verdict.label.capitalize()}: {row['statement'].item()}, {row['place'].item()}{seen}. {_start(told)}"
            )
    return sentences


def _start(text: str) -> str:
    return text[:1].upper() + text[1:]


def claim_table(claims: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Heads and a row a claim, in the order of the paper; reasons stand in the sentences and in claims.json."""
    words = {Verdict.HOLDS: "yes", Verdict.DOES_NOT_HOLD: "no", Verdict.NOT_DECIDED: "not decided"}
    rows = []
    for at in range(claims.sizes["claim"]):
        row = claims.isel(claim=at)
        verdict = Verdict(int(row["verdict"]))
        near = "" if row["sure"].item() or verdict is Verdict.NOT_DECIDED else ", but within the numerical error"
        rows.append(
            [
                row["statement"].item(), row["place"].item(), words[verdict] + near, _value(row), _limits(row),
                row["quantity"].item(),
            ]
        )  # fmt: skip
    return list(_HEADS), rows


def _value(row: xr.Dataset) -> str:
    value, error = float(row["value"]), float(row["error"])
    if not math.isfinite(value):
        return "not known"
    spread = f" +- {error:.2g}" if math.isfinite(error) and error > 0 else ""
    digits = f"{value:.6g}" if abs(value - 1) < 1e-2 else number(float(f"{value:.3g}")) if value % 1 else f"{value:g}"
    return with_unit(digits + spread, unit_text(str(row["unit"].item())))


def _limits(row: xr.Dataset) -> str:
    low, high = float(row["low"]), float(row["high"])
    unit = unit_text(str(row["unit"].item()))
    if math.isfinite(low) and math.isfinite(high):
        return with_unit(f"{low:g}" if low == high else f"{low:g} to {high:g}", unit)
    return with_unit(f"at least {low:g}" if math.isfinite(low) else f"at most {high:g}", unit)

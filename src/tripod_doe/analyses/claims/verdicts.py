"""The paper's claims: statement, quantity that decides it, its tolerance, and whether it holds, for each.

Its cases have skews that the paper does not print: they are settings, and `over_skew` decides for many.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import Evidence, Measured, MissingPointError
from tripod_doe.analyses.claims.rules import RULES, Rule
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.model_interface import Flag
from tripod_doe.study.definition.study_file_schema import Table


class Verdict(Flag):
    """Whether a claim holds; the integer is the CF flag value."""

    DOES_NOT_HOLD = 0
    HOLDS = 1
    NOT_DECIDED = 2


VERDICT_FLAGS = Verdict.attributes("whether the claim holds")
"""CF attributes of verdicts."""

_KNOWN = "The reason that is known for the usual values of all parameters, from which these may differ: "


class ClaimsSettings(Table):
    """Settings of the claims as a step of a workflow."""

    model: str = Field("needles", description="model whose points decide the claims")
    small_skew_deg: float = Field(0.2, gt=0, description="skew of case 1, signs + - +; not printed in the paper")
    large_skew_deg: float = Field(0.4, gt=0, description="skew of cases 2, 3 and 4; not printed in the paper")


_VARIABLES = {
    "statement": "what the paper says",
    "place": "section and figure of the paper",
    "quantity": "quantity that decides the claim",
    "unit": "unit of value, error and limits",
    "value": "value from the cubes",
    "error": "numerical error of the value, from the errors of the amplitudes; missing if unknown",
    "low": "smallest value for which the claim holds; missing if there is no such limit",
    "high": "largest value for which the claim holds; missing if there is no such limit",
    "sure": "1 where value and limits differ by more than the numerical error",
    "reason": "why it does not hold or is not decided, and values behind it",
    "points": "points that decide it: each step with numbers of its points",
}


@makes_kind("claims")
def check_claims(cubes: Mapping[str, xr.Dataset], settings: ClaimsSettings) -> xr.Dataset:
    """Decide every claim by the points of these cubes, chosen by their parameters.

    Returns:
        One row per claim. ``verdict`` is holds, does_not_hold, or not_decided: a point that the claim needs is missing
        or did not finish, or its points are of different joints. Missing points are never replaced by others.
    """
    evidence, cases = Evidence(cubes), Cases(settings.model, settings.small_skew_deg, settings.large_skew_deg)
    rows = [_decide(rule, evidence, cases) for rule in RULES]
    verdicts = np.array([row.pop("verdict") for row in rows], np.int8)
    columns = {
        name: ("claim", np.array([row[name] for row in rows]), {"long_name": meaning})
        for name, meaning in _VARIABLES.items()
    }
    names = np.array([rule.name for rule in RULES])
    return xr.Dataset(
        columns | {"verdict": ("claim", verdicts, VERDICT_FLAGS)},
        coords={"claim": ("claim", names, {"long_name": "claim"})},
        attrs={"title": "Claims of the paper", "model": settings.model, "cases": cases.text},
    )


def _decide(rule: Rule, evidence: Evidence, cases: Cases) -> dict[str, Any]:
    """A row of the table."""
    evidence.begin()
    try:
        measured, verdict = rule.measure(evidence, cases), Verdict.NOT_DECIDED
    except MissingPointError as missing:
        measured, verdict = Measured(math.nan, math.nan, f"not decided: {missing}"), Verdict.NOT_DECIDED
    if math.isfinite(measured.value):
        verdict = Verdict(int(_inside(rule, measured.value)))
    elif not measured.note:
        measured = Measured(math.nan, math.nan, "not decided: the value could not be computed")
    reach = measured.error if math.isfinite(measured.error) else 0.0
    ends = {_inside(rule, measured.value + change) for change in (-reach, 0.0, reach)}
    reasons = [_KNOWN + rule.why_not] if verdict is Verdict.DOES_NOT_HOLD and rule.why_not else []
    return {
        "statement": rule.statement,
        "place": rule.place,
        "quantity": rule.quantity,
        "unit": rule.unit,
        "value": measured.value,
        "error": measured.error,
        "low": math.nan if rule.low is None else rule.low,
        "high": math.nan if rule.high is None else rule.high,
        "verdict": verdict,
        "sure": np.int8(verdict is not Verdict.NOT_DECIDED and len(ends) == 1),
        "reason": " ".join([*([measured.note] if measured.note else []), *reasons]),
        "points": "; ".join(" ".join(map(str, [name, *sorted(used)])) for name, used in evidence.used.items()),
    }


def _inside(rule: Rule, value: float) -> bool:
    return (rule.low is None or value >= rule.low) and (rule.high is None or value <= rule.high)


def claims_json(claims: xr.Dataset) -> str:
    """The table as JSON: a list of claims; ``holds`` is null if one is not decided."""
    holds = {Verdict.HOLDS: True, Verdict.DOES_NOT_HOLD: False, Verdict.NOT_DECIDED: None}
    records = []
    for at, name in enumerate(claims["claim"].values):
        row = claims.isel(claim=at)
        low, high, value, error = (_or_none(float(row[key])) for key in ("low", "high", "value", "error"))
        records.append(
            {
                "claim": str(name),
                "statement": str(row["statement"].item()),
                "where": str(row["place"].item()),
                "quantity": str(row["quantity"].item()),
                "unit": str(row["unit"].item()),
                "tolerance": {"low": low, "high": high},
                "value": value,
                "numerical_error": error,
                "holds": holds[Verdict(int(row["verdict"]))],
                "beyond_numerical_error": None if error is None else bool(row["sure"]),
                "reason": str(row["reason"].item()),
            }
        )
    head = {key: str(claims.attrs[key]) for key in ("model", "cases") if key in claims.attrs}
    return json.dumps(head | {"claims": records}, indent=1, ensure_ascii=False)


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None

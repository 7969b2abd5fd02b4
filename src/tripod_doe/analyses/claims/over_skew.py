"""The paper's claims for every choice of the skews that it does not print."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.claims.verdicts import VERDICT_FLAGS, ClaimsSettings, Verdict, check_claims
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file_schema import Table


class ClaimsOverSkewSettings(Table):
    """Settings of the claims over skew as a step of a workflow."""

    title: str = Field("Claims over the chosen skews", description="heading on a report page")
    model: str = Field("needles", description="model whose points decide the claims")
    skews_deg: list[Annotated[float, Field(gt=0)]] = Field(
        min_length=2, description="skews of cases 2, 3 and 4, evaluated one after the other; case 1 has half of each"
    )


@makes_kind("claims-over-skew")
def claims_over_skew(cubes: Mapping[str, xr.Dataset], settings: ClaimsOverSkewSettings) -> xr.Dataset:
    """Decide the claims once for every choice of the skews.

    Returns:
        value, error and verdict (claim, skew_deg), of those claims that the cubes decide for at least one choice, with
        statement, place, quantity, unit and limits as of the claims themselves.

    Raises:
        InputError: If the cubes decide no claim for any of these skews.
    """
    tables = [
        check_claims(cubes, ClaimsSettings(model=settings.model, small_skew_deg=skew / 2, large_skew_deg=skew))
        for skew in settings.skews_deg
    ]
    over = xr.Variable("skew_deg", settings.skews_deg, {"long_name": "skew of cases 2 to 4", "units": "degree"})
    joined = xr.concat([table[["value", "error", "verdict"]] for table in tables], over)
    text = tables[0][["statement", "place", "quantity", "unit", "low", "high"]]
    without_points = check_claims({}, ClaimsSettings(model=settings.model))["verdict"] != Verdict.NOT_DECIDED
    decided = (joined["verdict"] != Verdict.NOT_DECIDED).any("skew_deg") & ~without_points
    if not bool(decided.any()):
        raise InputError(f"no claim is decided for any of the skews {', '.join(f'{s:g}' for s in settings.skews_deg)}")
    result = xr.merge([joined.transpose("claim", "skew_deg"), text]).isel(claim=np.flatnonzero(decided.values))
    result["verdict"].attrs = VERDICT_FLAGS
    return result.assign_attrs(title=settings.title, model=settings.model)

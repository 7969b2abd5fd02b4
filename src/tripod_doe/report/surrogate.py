"""Findings of a surrogate: how well it predicts what it has not seen."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.quantities import number, with_unit
from tripod_doe.report.responses import ORDINALS

__all__ = ["find_in_surrogate"]

_NEARLY_ALL = 99.9  # percent


def find_in_surrogate(name: str, result: xr.Dataset) -> list[str]:
    """One sentence on the surrogate of each main output.

    Parameters
    ----------
    name
        Name of the analysis.
    result
        Its errors.
    """
    words = str(result["chosen"].attrs["flag_meanings"]).split()
    outputs = [str(output) for output in result["output"].values] if "output" in result.dims else []
    if "thrust_amplitude" in outputs:
        outputs = ["thrust_amplitude"]
    sentences = []
    for output in outputs[:4] or [str(result.attrs["outputs"])]:
        of_output = result.sel(output=output) if outputs else result
        for order in (3, 2) if "order" in result.dims else (None,):
            part = of_output if order is None else of_output.sel(order=order)
            part = part.isel(dict.fromkeys(part["error_rms"].dims, 0))
            if not np.isfinite(part["error_rms"]):
                continue
            what = output if order is None else f"the {ORDINALS[order]}"
            unit = "N" if output.startswith("thrust") else ""
            kind = words[int(part["chosen"]) + 1].replace("-", " ")
            error = with_unit(number(float(part["error_rms"]), 2), unit)
            largest = with_unit(number(float(part["error_largest"]), 2), unit)
            share = 100 * float(part["predicted_part"])
            told = "more than 99.9" if share > _NEARLY_ALL else number(share)
            sentences.append(
                f"A surrogate of {what} ({kind}) misses points that it has not seen by {error} (root mean square), by "
                f"{largest} at most, and predicts {told} % of the variance "
                f"(analysis {name})."
            )
    return sentences

"""Findings of a surrogate: how well it predicts what it has not seen."""

from __future__ import annotations

import xarray as xr

from tripod_doe.quantities import number, with_unit
from tripod_doe.report.main_outputs import main_outputs

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
    sentences = []
    for _, what, unit, part in main_outputs(result, "error_rms"):
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

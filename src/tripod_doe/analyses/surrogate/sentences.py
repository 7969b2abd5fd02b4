"""Findings of a surrogate: how well it predicts what it has not seen."""

import numpy as np
import xarray as xr

from tripod_doe.analyses.surrogate.what_if_page import what_if_pages
from tripod_doe.number_text import number, with_unit
from tripod_doe.page_parts.main_outputs import left_points, main_outputs
from tripod_doe.page_parts.words import listed

_NEARLY_ALL = 99.9  # percent


def find_in_surrogate(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on the surrogate of each main output, and on the quantiles that it gives."""
    words = str(result["chosen"].attrs["flag_meanings"]).split()
    sentences = []
    for _, what, unit, part in main_outputs(result, "error_rms"):
        kind = words[int(part["chosen"]) + 1].replace("-", " ")
        error = with_unit(number(float(part["error_rms"]), 2), unit)
        largest = with_unit(number(float(part["error_largest"]), 2), unit)
        share = 100 * float(part["predicted_part"])
        text = "more than 99.9 %" if share > _NEARLY_ALL else f"{number(share)} %" if share > 0 else "nothing"
        sentences.append(
            f"Surrogate of {what} ({kind}): error {error} (root mean square) and at most {largest} at points that it "
            f"was not fitted to; it predicts {text} of the variance (analysis {name})."
        )
    return sentences + left_points(result) + _quantiles(name, result)


def _quantiles(name: str, result: xr.Dataset) -> list[str]:
    """What is known between levels; then quantiles of what the page shows, where the factors are independent.

    Of points that fail together, the others do not follow these distributions.
    """
    sentences = []
    for page in what_if_pages({name: result}):
        sentences += [f"{note} (analysis {name})." for note in page.between_levels]
        if unknown := [each.label for each in page.quantities if not each.known]:
            sentences.append(
                f"The surrogate predicts less than half of the variance of {listed(unknown)}: no quantiles and no "
                f"curves are shown (analysis {name})."
            )
        if not page.surrogate.sampled or "failing_region" in result.attrs:
            continue
        for each, values in zip(page.quantities, page.drawn(), strict=True):
            if not each.known:
                continue
            chances = np.array([0.05, 0.5, 0.95])
            ranks = chances + np.array([[-1.96], [0], [1.96]]) * np.sqrt(chances * (1 - chances) / values.size)
            below, quantiles, above = np.quantile(values, ranks)
            noise = float(np.maximum(above - quantiles, quantiles - below).max())
            low, middle, high = (number(float(value)) for value in each.placed(quantiles))
            sentences.append(
                f"By the surrogate, not by a model: {each.label} below {with_unit(low, each.unit)} in 5 %, below "
                f"{with_unit(middle, each.unit)} in 50 % and below {with_unit(high, each.unit)} in 95 % of "
                f"{values.size:,} drawn cases, whose number leaves {with_unit(number(noise, 1), each.unit)} open "
                f"(analysis {name})."
            )
    return sentences

"""All figures by the names that workflow files use."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.report.contributions import contributions
from tripod_doe.report.figures.chart import Chart
from tripod_doe.report.figures.comparison import comparison_charts
from tripod_doe.report.figures.contributions import contribution_chart
from tripod_doe.report.figures.effects import effect_charts
from tripod_doe.report.figures.indices import index_charts
from tripod_doe.report.figures.loci import locus_chart
from tripod_doe.report.figures.outcomes import outcome_charts
from tripod_doe.report.figures.paper import (
    friction_law_chart,
    local_order_charts,
    order_angle_chart,
    spectrum_of_all,
    waveforms_of_all,
)
from tripod_doe.report.figures.skews import findings_over_skew_charts, kept_skew_charts, skew_chart
from tripod_doe.report.figures.speed_accuracy import model_error_charts, speed_accuracy_charts
from tripod_doe.report.figures.stability import stability_charts
from tripod_doe.report.figures.waveforms import spectrum_chart, waveform_charts

__all__ = ["FIGURES", "Figure"]

Figure = Callable[[Mapping[str, xr.Dataset]], list[Chart]]


def _of_one(draw: Callable[[xr.Dataset], list[Chart]]) -> Figure:
    """A figure of one cube, told where it is given several."""

    def figure(inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
        if len(inputs) != 1:
            raise InputError(f"this figure shows one input, it has {len(inputs)}: {', '.join(inputs)}")
        return draw(next(iter(inputs.values())))

    return figure


def _indices(inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
    cubes = [data for data in inputs.values() if "outcome" in data]
    if len(cubes) != 1:
        raise InputError("the figure indices needs one study and its sensitivity analyses as inputs")
    return index_charts({name: data for name, data in inputs.items() if "outcome" not in data}, cubes[0])


def _maybe(draw: Callable[[xr.Dataset], Chart | None]) -> Figure:
    return _of_one(lambda cube: [chart] if (chart := draw(cube)) else [])


FIGURES: dict[str, Figure] = {
    "waveforms": _of_one(waveform_charts),
    "spectrum": _maybe(spectrum_chart),
    "effects": _of_one(lambda cube: [chart for group in effect_charts(cube) for chart in group.charts]),
    "loci": _maybe(locus_chart),
    "indices": _indices,
    "comparison": _of_one(comparison_charts),
    "contribution": lambda inputs: [contribution_chart(part) for part in contributions(inputs) if not part.missing],
    "waveforms-of-all": _of_one(waveforms_of_all),
    "local-orders": _of_one(local_order_charts),
    "orders-over-angle": _maybe(order_angle_chart),
    "skew": _maybe(skew_chart),
    "kept-skew": _of_one(kept_skew_charts),
    "findings-over-skew": _of_one(findings_over_skew_charts),
    "spectrum-of-all": _maybe(spectrum_of_all),
    "friction-law": _maybe(friction_law_chart),
    "speed-accuracy": _of_one(speed_accuracy_charts),
    "model-error": _of_one(model_error_charts),
    "outcome-map": _of_one(outcome_charts),
    "stability-map": _of_one(stability_charts),
}
"""Figures by name: functions from the cubes of their input steps to charts."""

"""All figures by the names that workflow files use: those of studies here, those of analyses in their rows."""

from __future__ import annotations

from tripod_doe.analyses.claims.skew_charts import findings_over_skew_charts, kept_skew_charts, skew_chart
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.analyses.model_choice.charts import model_choice_chart
from tripod_doe.analyses.registry import ANALYSES
from tripod_doe.report.charts.inputs import Figure, of_one, one_chart
from tripod_doe.report.charts.loci import locus_chart
from tripod_doe.report.charts.outcomes import outcome_charts
from tripod_doe.report.charts.paper import (
    friction_law_chart,
    local_order_charts,
    order_angle_chart,
    spectrum_of_all,
    waveforms_of_all,
)
from tripod_doe.report.charts.waveforms import spectrum_chart, waveform_charts

_OF_STUDIES: dict[str, Figure] = {
    "waveforms": of_one(waveform_charts),
    "spectrum": one_chart(spectrum_chart),
    "effects": of_one(lambda cube: [chart for group in effect_charts(cube) for chart in group.charts]),
    "loci": one_chart(locus_chart),
    "waveforms-of-all": of_one(waveforms_of_all),
    "local-orders": of_one(local_order_charts),
    "orders-over-angle": one_chart(order_angle_chart),
    "skew": one_chart(skew_chart),
    "kept-skew": of_one(kept_skew_charts),
    "findings-over-skew": of_one(findings_over_skew_charts),
    "spectrum-of-all": one_chart(spectrum_of_all),
    "friction-law": one_chart(friction_law_chart),
    "model-choice": one_chart(model_choice_chart),
    "outcome-map": of_one(outcome_charts),
}

FIGURES: dict[str, Figure] = _OF_STUDIES | {
    name: figure for analysis in ANALYSES.values() for name, figure in analysis.figures.items()
}
"""Figures by name: functions from the cubes of their input steps to charts."""

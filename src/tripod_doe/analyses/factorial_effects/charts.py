"""Effects of a factorial or response-surface design as bars."""

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.factorial_effects.sentences import effect_parts, term_text
from tripod_doe.page_parts.charts.chart import COLOURS, INTERVALS, MUTED, Chart, drawing, intervals_text, name_rows

_MOST_BARS = 12


def factorial_effect_charts(result: xr.Dataset, name: str) -> list[Chart]:
    """One chart per main output: the largest effects with their intervals."""
    return [
        _chart(f"{name}-{position}", name, what, part)
        for position, (_, what, _, part) in enumerate(effect_parts(result), 1)
    ]


def _chart(key: str, name: str, what: str, part: xr.Dataset) -> Chart:
    data = pd.DataFrame({key: part[key].values for key in ("term", "effect", "effect_conf", "p_value")})
    data = data.sort_values("effect", key=np.abs, ascending=False, kind="stable", ignore_index=True)
    shown = data.head(_MOST_BARS)
    rows = np.arange(len(shown))[::-1]
    with drawing(5.0, 1.0 + 0.3 * len(shown)) as (figure, axes):
        axes.barh(rows, shown["effect"], 0.6, color="#b9d0e8", edgecolor=COLOURS[0], lw=0.8)
        axes.errorbar(shown["effect"], rows, xerr=shown["effect_conf"], **INTERVALS)
        name_rows(axes, rows, [term_text(str(term)) for term in shown["term"]])
        axes.axvline(0, color=MUTED, lw=0.8)
        axes.set_xlabel("effect, from low to high, in the unit of the output")
    level = 100 * float(part.attrs.get("confidence_level", 0.95))
    more = f" The {_MOST_BARS} largest of {len(data)}." if len(data) > _MOST_BARS else ""
    caption = f"Effects on {what}{intervals_text(data['effect_conf'], level)} (analysis {name}).{more}"
    return Chart(key, f"Effects on {what}", caption, figure, data)

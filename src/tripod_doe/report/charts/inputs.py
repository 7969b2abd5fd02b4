"""Types of figure functions: from the cubes of a step's inputs to charts."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.report.charts.chart import Chart

Figure = Callable[[Mapping[str, xr.Dataset]], list[Chart]]
"""Cubes and analysis results by the names of their steps -> charts."""


def of_one(draw: Callable[[xr.Dataset], list[Chart]]) -> Figure:
    """A figure of exactly one input; several are refused with their names."""

    def figure(inputs: Mapping[str, xr.Dataset]) -> list[Chart]:
        if len(inputs) != 1:
            raise InputError(f"this figure shows one input, it has {len(inputs)}: {', '.join(inputs)}")
        return draw(next(iter(inputs.values())))

    return figure


def one_chart(draw: Callable[[xr.Dataset], Chart | None]) -> Figure:
    """A figure of one input with one chart, or none where the input lacks what it shows."""
    return of_one(lambda cube: [chart] if (chart := draw(cube)) else [])

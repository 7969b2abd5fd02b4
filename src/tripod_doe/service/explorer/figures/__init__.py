"""Figures that answer a pointer: functions Dataset -> Figure, for the page of `tripod-doe serve` and for notebooks.

A figure is a dictionary with ``data`` and ``layout`` in the form of Plotly: `plotly.graph_objects.Figure` takes it as
it is. It holds no colours of its own where a reader's theme decides: the page adds them.
"""

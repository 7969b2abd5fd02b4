"""Figures that answer a pointer: functions Dataset -> Figure, for the page of `tripod-doe serve` and for notebooks.

A figure is a dictionary with ``data`` and ``layout`` in Plotly's form: `plotly.graph_objects.Figure` takes it
unchanged. It leaves out the colours that depend on the reader's theme: the page adds them.
"""

"""Analyses, one folder each: the computation (Dataset -> Dataset), its `sentences` and its `charts`.

All stand in the `registry`. Beside the folders: the points and outputs that an analysis reads, the bootstrap, settings.
"""

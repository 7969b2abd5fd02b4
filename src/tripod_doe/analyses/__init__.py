"""Analyses, one folder each: the computation (Dataset -> Dataset), its `sentences` and its `charts`.

All are in the `registry`. Besides the folders: the points and outputs that an analysis reads, the bootstrap, settings.
"""

"""The cube of a study: made from finished blocks, written to netCDF files and read from them, whole or in parts.

Queries of cubes are in `study.query`.
"""

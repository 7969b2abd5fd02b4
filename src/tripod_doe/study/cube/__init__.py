"""The cube of a study: made from finished blocks, written to netCDF files and read from them, also part by part.

What is asked of a cube is no part of it.
"""

"""Execution of the points of a study: blocks, in this process or on Dask workers. Results are stored elsewhere."""

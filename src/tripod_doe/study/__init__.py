"""Studies: a checked definition, its points, their execution on Dask, the journal, and the result cube."""

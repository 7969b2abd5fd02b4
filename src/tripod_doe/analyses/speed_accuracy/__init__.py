"""Error over CPU time of methods and models."""

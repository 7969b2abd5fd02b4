"""Several models at once: what the most expensive one would answer, from few of its samples and many of others."""

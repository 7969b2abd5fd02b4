"""Optimisation: its file, candidates and operating points, the search, the front, and what is stated of it."""

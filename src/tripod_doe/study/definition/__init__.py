"""The definition of a study: its file parsed and checked, factors with distributions, functions, retries; no points."""

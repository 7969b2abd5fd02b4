"""The definition of a study: its file parsed and checked, what its factors, functions and retries may be; no points."""

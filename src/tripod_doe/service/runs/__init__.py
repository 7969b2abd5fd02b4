"""Runs: their table, the processes that compute them, their progress, and the events that say what changed."""

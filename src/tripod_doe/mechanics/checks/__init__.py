"""Checks of a run: energy, halved steps, limits of a step, stability. Outcomes are set by `run`."""

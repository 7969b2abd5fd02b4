"""Analyses: functions from cube to cube, found by their kind."""

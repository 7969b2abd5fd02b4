"""Workflows: chains of studies, analyses and reports; `run` is the workflow of one study."""

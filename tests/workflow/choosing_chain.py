"""A chain that chooses the models of `study.toml` from a pilot of its own, `pilot.toml`."""

CHAIN = """
[workflow]
name = "Choose"
[steps.pilot]
kind = "study"
study = "pilot.toml"
[steps.choice]
kind = "choose"
inputs = ["pilot"]
settings = { study = "study.toml" }
[steps.map]
kind = "study"
study = "study.toml"
inputs = ["choice"]
table = "choice"
"""

"""Scenes made of mechanics alone: a needle between plates and a roller in its groove, as simulators for studies."""

"""Scenes made of mechanics alone: examples, tests with closed forms, and simulators for studies."""

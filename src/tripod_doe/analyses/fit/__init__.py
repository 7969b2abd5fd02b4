"""Fit of the joint's unknown parameters to measured records, and what the records say of each."""

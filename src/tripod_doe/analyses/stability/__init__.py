"""Largest stable step of each method, measured and predicted."""

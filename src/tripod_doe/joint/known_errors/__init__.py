"""Measured errors of each model on record, and the error estimated from them at any point."""

"""Comparison of a measured thrust force with the model: reading records, order tracking, orders, phases and beat."""

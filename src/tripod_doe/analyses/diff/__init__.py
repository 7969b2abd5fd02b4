"""Differences of two studies and of their results at the points that they share (`tripod-doe diff A B`)."""

"""Contribution of each friction mechanism to the thrust force, from studies that switch mechanisms off."""

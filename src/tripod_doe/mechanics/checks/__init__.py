"""Checks of a run: its energy balance, its steps halved. Outcomes are set by `run`, limits of steps by `stability`."""

"""Self-excited vibration: whether a joint vibrates, and its run with the vibration."""

"""Charts: the common style of all drawings, and those of the cube of any study (orders, waveforms, outcomes)."""

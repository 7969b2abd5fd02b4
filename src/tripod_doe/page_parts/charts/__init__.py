"""Charts: the common style of all drawings, and drawings for any study (orders, waveforms, outcomes)."""

"""A process of ours: its settings, its threads, its interrupts. Imported before anything else."""

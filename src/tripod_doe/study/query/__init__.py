"""Questions to a cube: selections of labels, `--where` conditions (`study.expressions`) and records; no analyses."""

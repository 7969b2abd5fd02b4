"""Parameter studies, from the study file to the cube; models, analyses and pages are known here by protocols only."""

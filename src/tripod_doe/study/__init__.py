"""Parameter studies, from the study file to the cube; models, analyses and pages only through protocols."""

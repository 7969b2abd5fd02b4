"""Pages: the report of a study, of a workflow and of a report step, made of analyses and what `report` shares."""

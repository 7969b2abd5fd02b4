"""The paper's claims in a report: sentences and tables."""

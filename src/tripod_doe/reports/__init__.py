"""Whole pages and workbooks: reports of studies, workflows, fits and searches, `.xlsx` of results."""

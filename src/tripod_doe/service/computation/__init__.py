"""Questions about texts and cubes, answered in worker processes of limited time and memory; no web code."""

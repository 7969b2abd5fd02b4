"""Worker processes that answer questions about texts and cubes, in limited time and memory; no web code."""

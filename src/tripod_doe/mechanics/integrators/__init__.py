"""Time integration: one method a file, one contract (`contract`), one registry (`registry`)."""

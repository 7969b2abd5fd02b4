"""Time integration: one method a file, one interface (`method_interface`), one registry (`registry`)."""

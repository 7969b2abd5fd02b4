"""The result directory of a study: its lock, its content, its check, resuming, and its cube opened again."""

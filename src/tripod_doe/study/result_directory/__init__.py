"""The result directory of a study: its lock, its content, its check, and its cube opened again."""

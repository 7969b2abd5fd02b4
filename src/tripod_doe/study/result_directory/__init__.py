"""The result directory of a study: who writes there, what it keeps, how it is checked, and its cube opened again."""

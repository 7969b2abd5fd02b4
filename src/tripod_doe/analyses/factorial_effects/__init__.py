"""Effects of factors and interactions by regression, for designs of experiments with few levels."""

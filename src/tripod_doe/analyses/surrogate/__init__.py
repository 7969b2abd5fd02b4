"""Surrogates of outputs over the factors, and their questions "what if" on a page."""

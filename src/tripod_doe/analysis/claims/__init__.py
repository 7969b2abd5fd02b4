"""The paper's claims: what each says, the number that decides it, and whether it holds for a model."""

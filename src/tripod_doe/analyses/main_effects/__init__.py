"""Effect of each factor on a response of any study, as far as its design separates it."""

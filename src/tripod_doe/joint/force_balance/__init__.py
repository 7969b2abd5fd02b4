"""The two models without time integration, `equilibrium` and `kinetostatic`: force balances at all rotation angles."""

"""Harmonic balance: how a force is sampled, linear terms and force assembled, the residual as symbols, the problem."""

"""Harmonic balance: the policy of sampling, linear terms and force in numbers, the balance as symbols, the problem."""

"""Floquet multipliers: collocation of the linearised equations over a period."""

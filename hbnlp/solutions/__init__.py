"""Periodic solutions: their record, their equations and unknowns, how one is solved for and all are searched for."""

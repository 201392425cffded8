"""The membrane wing: membranes, their coupling with aerodynamics, linear lift response."""

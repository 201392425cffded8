"""The membrane wing: strain, tension and membranes, their coupling with aerodynamics, linear lift response."""

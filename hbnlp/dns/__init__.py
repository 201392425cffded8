"""Incompressible flow past thin and closed bodies, alone or coupled with a membrane, by an immersed-boundary projection method."""

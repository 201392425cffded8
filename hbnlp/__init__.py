"""Nonlinear frequency response of membrane wings and other forced oscillators."""

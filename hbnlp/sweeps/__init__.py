"""Marching through values of a parameter, by Newton's method or by direct integration, with the jumps."""

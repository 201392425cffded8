"""Curves R(y) = 0: Newton's method, one step, branch points on the way, and the walk; knows no harmonic balance."""

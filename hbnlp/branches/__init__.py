"""Branches of periodic solutions: their points, special points, curves of folds, and the tracer."""

"""Nonlinear programs over responses: variables shared by several periodic solutions, folds among them."""

from hbnlp.design.programs import Optimum, Program, Response, Variables, fold_at, response_at

__all__ = ["Optimum", "Program", "Response", "Variables", "fold_at", "response_at"]

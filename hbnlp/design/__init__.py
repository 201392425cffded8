"""Nonlinear programs over responses: variables shared by several periodic solutions, folds among them."""

from hbnlp.design.program import Optimum, Program
from hbnlp.design.responses import Response, fold_at, response_at
from hbnlp.design.variables import Variables

__all__ = ["Optimum", "Program", "Response", "Variables", "fold_at", "response_at"]

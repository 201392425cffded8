"""What the multipliers of two neighbouring points imply, and the functions by which it is located."""

from types import SimpleNamespace

import numpy as np

from hbnlp.branches.floquet_points import bifurcation_function, crossings
from hbnlp.core.kinds import Kind
from hbnlp.stability.result import Floquet


def test_a_product_of_many_factors_locates_whatever_its_size_at_the_ends():
    # a real multiplier comes in and its product with another passes one, beside forty that are near one at one end only
    def result(real, others):
        many = np.concatenate([[real, 1.003], np.repeat(others, 40)])
        return SimpleNamespace(multipliers=many.astype(complex), converged=True, options=Floquet())

    before, after = result(1.01, 0.9999), result(0.9, 0.5)
    assert crossings(before, after) == (Kind.NEIMARK_SACKER,)
    test = bifurcation_function(Kind.NEIMARK_SACKER, before, after, lambda point: point)
    assert test is not None
    assert test(before) * test(after) < 0.0

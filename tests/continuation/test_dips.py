"""Pairs of zeros within a step are found by the dip between them, whatever is known of what lies before the step."""

import numpy as np
import pytest

from hbnlp.continuation.dips import Sample, crossing_in


def sample(place):
    """x^2 - 0.01, which is positive but for a fifth of the step from -1 to 1."""
    value = place**2 - 0.01
    return Sample(place, float(np.sign(value)), float(np.log(abs(value))))


@pytest.mark.parametrize("before", [-2.0, -1.0, None], ids=["before", "where it begins", "none"])
def test_a_pair_of_zeros_is_found_also_where_the_step_before_was_taken_back(before):
    earlier = None if before is None else sample(before)
    place = crossing_in(earlier, sample(-1.0), sample(1.0), sample)
    assert abs(place) < 0.1


def test_what_has_no_dip_is_looked_at_in_vain():
    def rises(place):
        return Sample(place, 1.0, place)

    assert crossing_in(rises(-2.0), rises(-1.0), rises(1.0), rises) is None

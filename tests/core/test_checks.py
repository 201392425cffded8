"""Checks of arguments: what passes, and what the message of one that does not pass says."""

import numpy as np
import pytest

from hbnlp.core.checks import instance_of, list_of_callables, real_number, whole_number


@pytest.mark.parametrize("value", [3, np.int32(3), np.array(3)])
def test_integers_of_any_kind_pass(value):
    assert whole_number("n", value, least=1, most=3) == 3


@pytest.mark.parametrize("value", [0, 4, 2.0, "2", True, None, np.array([2])])
def test_what_is_no_integer_within_its_bounds_is_named(value):
    with pytest.raises(ValueError, match=r"n is .*; give an integer from 1 to 3: fewer"):
        whole_number("n", value, least=1, most=3, advice=": fewer")


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.array(2.0)])
def test_numbers_of_any_kind_pass(value):
    assert real_number("a", value, above=1.0) == 2.0


@pytest.mark.parametrize(
    ("value", "error"), [(1.0, ValueError), (np.nan, ValueError), (np.inf, ValueError), ("b", TypeError)]
)
def test_what_is_no_number_within_its_bounds_is_named(value, error):
    with pytest.raises(error, match=r"a is .*; give a finite number greater than 1 and of at least 0"):
        real_number("a", value, above=1.0, least=0.0)


def test_what_is_of_another_kind_is_named_in_one_line():
    instance_of("a", 1, int | None, "a number")
    instance_of("a", None, int | None, "a number")
    with pytest.raises(TypeError, match=r"^a is '2'; give a number$"):
        instance_of("a", "2", int | None, "a number")
    with pytest.raises(TypeError, match=r"^a is array.* \.\.\.; give a number$"):
        instance_of("a", np.arange(500), int, "a number")


@pytest.mark.parametrize("value", [print, None, "print", [print, 3], {"print": print}])
def test_callables_come_in_a_list(value):
    list_of_callables("callbacks", [print, len])
    list_of_callables("callbacks", ())
    with pytest.raises(TypeError, match=r"callbacks is .*; give a list of callables"):
        list_of_callables("callbacks", value)

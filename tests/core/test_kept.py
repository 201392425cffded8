"""Kept objects: built once while they are in use, and never more of them than allowed."""

import pytest

from hbnlp.core.kept import Kept


def test_an_object_is_built_once_and_the_least_used_goes_first():
    kept, built = Kept(2), []

    def get(key):
        return kept.get(key, lambda: built.append(key) or [key])

    first = get("a")
    assert get("b") is get("b")
    assert get("a") is first
    get("c")
    assert len(kept) == 2
    assert get("a") is first
    get("b")
    assert built == ["a", "b", "c", "b"]


def test_what_failed_to_be_built_is_not_kept():
    kept = Kept(2)

    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept.get("a", interrupted)
    assert len(kept) == 0
    assert kept.get("a", lambda: 1) == 1

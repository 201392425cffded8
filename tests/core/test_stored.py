"""Stored results of long runs."""

import pytest

from hbnlp.core import stored
from hbnlp.testing import stored_result


def test_a_stored_result_is_found_from_wherever_one_is(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert stored_result("march_up_50.json").read_text().startswith("{")


def test_a_result_that_is_not_there_is_missed_aloud():
    with pytest.raises(FileNotFoundError, match=r"name is 'none.json'; give a file that is in .*results or .*results"):
        stored_result("none.json")


def test_an_installed_package_has_them_within(monkeypatch, tmp_path):
    (tmp_path / "run.json").write_text("{}")
    monkeypatch.setattr(stored, "_PLACES", (tmp_path, tmp_path / "none"))
    assert stored_result("run.json") == tmp_path / "run.json"

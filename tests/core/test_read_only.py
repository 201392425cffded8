"""No record changes by what is done to the arrays and mappings that it gives away."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

from hbnlp.core.sending import ReadOnlyArrays
from tests.wrong_kinds import world

RECORDS = ("solution", "found", "branch", "fold", "curve", "sweep", "time_sweep", "response", "lifts", "rom", "history")
WAYS = {
    "as made": lambda record: record,
    "copied": copy.deepcopy,
    "sent": lambda record: pickle.loads(pickle.dumps(record)),  # noqa: S301 (it is made here)
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", RECORDS)
def test_arrays_and_mappings_of_a_record_cannot_be_written_to(name, way):
    record = WAYS[way](getattr(world(), name))
    assert isinstance(record, ReadOnlyArrays)
    for field in dataclasses.fields(record) if dataclasses.is_dataclass(record) else ():
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray) and value.size:
            with pytest.raises(ValueError, match="read-only"):
                value[...] = 0
        if isinstance(value, dict):
            with pytest.raises(TypeError, match="a record cannot be changed; take a copy"):
                value["omega"] = 1.0


def test_what_is_taken_from_a_record_is_not_its_own_to_change():
    w = world()
    for values in (w.branch.values("omega"), w.branch.harmonics("x"), w.solution.harmonics("x")):
        with pytest.raises(ValueError, match="read-only"):
            np.multiply(values, 2.0, out=values)
    with pytest.raises(TypeError, match="a record cannot be changed"):
        w.solution.parameters.update(omega=1.0)
    changed = {**w.solution.parameters, "omega": 1.0}
    assert type(changed) is dict
    assert changed["omega"] == 1.0
    assert w.solution.omega == 0.8


def test_whoever_made_the_array_of_a_record_may_go_on_writing_to_it():
    coefficients = np.zeros((1, 3))
    record = dataclasses.replace(world().solution, coefficients=coefficients)
    coefficients[0, 0] = 1.0
    assert record.coefficients is not coefficients

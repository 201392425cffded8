"""Parameters: names in order, values that can be overridden, and messages that help."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbnlp.systems.parameters import Namespace, ParameterSet, unknown_name

names = st.lists(st.text("abcdefgh_", min_size=1, max_size=5), min_size=1, max_size=6, unique=True)
finite = st.floats(-1e6, 1e6)
examples = settings(max_examples=30, deadline=None)


@examples
@given(names, st.data())
def test_values_come_in_the_order_of_the_names_and_back(keys, data):
    entries = {key: data.draw(finite) for key in keys}
    parameters = ParameterSet({"omega": 1.0, **entries})
    values = parameters.values()
    assert parameters.as_dict(values) == {"omega": 1.0, **entries}
    for key in keys:
        assert values[parameters.index(key)] == entries[key]


@examples
@given(names, st.data())
def test_values_given_override_the_defaults_and_leave_them_alone(keys, data):
    parameters = ParameterSet({**dict.fromkeys(keys, 0.5), "omega": 1.0})
    chosen = data.draw(st.sampled_from(keys))
    given_value = data.draw(finite)
    values = parameters.as_dict(parameters.values({chosen: given_value}))
    assert values == {**parameters.defaults, chosen: given_value}
    assert parameters.defaults[chosen] == (1.0 if chosen == "omega" else 0.5)


@examples
@given(names, st.data())
def test_values_are_ordered_by_name_whatever_the_order_of_the_mapping(keys, data):
    parameters = ParameterSet({"omega": 1.0, **{key: data.draw(finite) for key in keys}})
    shuffled = {name: parameters.defaults[name] for name in data.draw(st.permutations(parameters.names))}
    np.testing.assert_array_equal(parameters.ordered(shuffled), parameters.values())


def test_a_mapping_to_be_ordered_has_every_parameter_and_no_other():
    parameters = ParameterSet({"stiffness": 1.0, "omega": 1.0})
    with pytest.raises(KeyError, match="unknown parameter 'stifness'; did you mean 'stiffness'"):
        parameters.ordered({"stifness": 2.0, "omega": 1.0})
    with pytest.raises(KeyError, match=r"parameter 'stiffness' is missing \(given: omega\)"):
        parameters.ordered({"omega": 1.0})


def test_omega_is_always_a_parameter_and_the_last_one_unless_named():
    assert ParameterSet({"force": 0.1}).names == ("force", "omega")
    assert ParameterSet({"omega": 2.0, "force": 0.1}).names == ("omega", "force")


def test_a_parameter_without_value_must_be_given():
    with pytest.raises(ValueError, match=r"'omega' has no value; give one, for instance at=\{'omega': 1.0\}"):
        ParameterSet({"force": 0.1}).values()


def test_a_parameter_that_is_about_to_be_varied_may_be_without_a_value():
    values = ParameterSet({"force": 0.1}).values(but=("omega",))
    assert values[0] == 0.1
    assert np.isnan(values[1])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_value_given_must_be_finite(value):
    with pytest.raises(ValueError, match=r"parameter 'force' is -?(nan|inf); give a finite number"):
        ParameterSet({"force": 0.1}).values({"force": value, "omega": 1.0})


def test_a_default_must_not_be_infinite():
    with pytest.raises(ValueError, match="parameter 'force' is inf; give a finite number"):
        ParameterSet({"force": np.inf})


@pytest.mark.parametrize("value", ["much", None, [1.0, 2.0], np.ones(2)])
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises((ValueError, TypeError), match="parameter 'force'"):
        ParameterSet({"force": value})
    with pytest.raises((ValueError, TypeError), match="parameter 'force'"):
        ParameterSet({"force": 1.0, "omega": 1.0}).values({"force": value})


NO_NUMBERS = ["1.2", b"1", True, np.True_, 1.0 + 0j, np.complex64(1), np.array("1.2"), 10**400, ca.SX.sym("a")]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_text_truth_and_complex_values_are_no_numbers(value):
    parameters = ParameterSet({"force": 0.1, "omega": 1.0})
    for call in (
        lambda: ParameterSet({"force": value}),
        lambda: parameters.values({"force": value}),
        lambda: parameters.series("force", [0.1, value]),
        lambda: parameters.span("force", (0.1, value)),
    ):
        with pytest.raises(ValueError, match=r"give .*finite (number|values)"):
            call()


@pytest.mark.parametrize("value", [2, np.float32(2.0), np.int64(2), np.array(2.0), Fraction(2), ca.DM(2.0)], ids=repr)
def test_real_numbers_of_any_kind_are_values(value):
    parameters = ParameterSet({"omega": value})
    assert parameters.values() == parameters.values({"omega": value}) == parameters.series("omega", [value]) == [2.0]
    assert parameters.span("omega", (1.0, value)) == (1.0, 2.0)


@pytest.mark.parametrize("omega", [0, 0.0, -1.2])
def test_omega_is_positive_where_there_is_a_period(omega):
    parameters = ParameterSet({"omega": omega})
    for call in (parameters.values, lambda: ParameterSet({}).values({"omega": omega})):
        with pytest.raises(ValueError, match=r"^omega = -?[\d.]+; the period of the excitation is .*: give omega > 0"):
            call()
    with pytest.raises(ValueError, match=r"values of omega reach -?[\d.]+; .* omega > 0"):
        parameters.series("omega", [1.0, omega])
    assert parameters.values(but=("omega",)) == parameters.values({"omega": omega}, but=("omega",)) == [omega]


def test_values_come_in_a_mapping():
    with pytest.raises(TypeError, match=r"at is 1\.2; give a mapping of parameter names to values"):
        ParameterSet({}).values(1.2)
    with pytest.raises(KeyError, match="unknown parameter 1 "):
        ParameterSet({}).values({1: 1.2})


@pytest.mark.parametrize("name", ["c T", "2mu", "a-b", ""])
def test_a_name_must_be_an_identifier(name):
    with pytest.raises(ValueError, match="give a Python identifier"):
        ParameterSet({name: 1.0})


def test_an_unknown_name_is_refused_with_the_nearest_known_one():
    parameters = ParameterSet({"stiffness": 1.0, "omega": 1.0})
    for call in (lambda: parameters.index("stifness"), lambda: parameters.values({"stifness": 2.0})):
        with pytest.raises(KeyError, match="unknown parameter 'stifness'; did you mean 'stiffness'"):
            call()
    with pytest.raises(KeyError, match="unknown parameter 'stifness'"):
        parameters.values(but=("stifness",))


def test_the_message_lists_what_is_known():
    assert unknown_name("output", "zzz", ("C_L", "W1")) == "unknown output 'zzz' (known: C_L, W1)"
    assert unknown_name("output", "zzz", ()) == "unknown output 'zzz' (known: none)"


def test_a_namespace_reads_by_attribute_and_by_item():
    p = Namespace("parameter", {"omega": 2.0, "mu": 0.5})
    assert p.omega == p["omega"] == 2.0
    assert dict(p) == {"omega": 2.0, "mu": 0.5}
    assert len(p) == 2
    assert repr(p) == "<parameters: omega, mu>"


def test_a_namespace_names_the_nearest_entry_for_a_wrong_one():
    p = Namespace("parameter", {"omega": 2.0})
    with pytest.raises(AttributeError, match="unknown parameter 'omga'; did you mean 'omega'"):
        _ = p.omga
    with pytest.raises(KeyError, match="unknown parameter 'omga'; did you mean 'omega'"):
        _ = p["omga"]


def test_a_namespace_is_read_only():
    p = Namespace("parameter", {"omega": 2.0})
    with pytest.raises(TypeError):
        p["omega"] = 3.0
    with pytest.raises(AttributeError):
        p.omega = 3.0
    assert p.omega == p["omega"] == 2.0


def test_a_value_below_the_least_that_has_a_meaning_is_refused_wherever_it_is_given():
    parameters = ParameterSet({"stiffness": 1.0, "omega": 1.0}, least={"stiffness": 0.0})
    message = "-1.*; give values of stiffness of at least 0"
    for give in (
        lambda: parameters.values({"stiffness": -1}),
        lambda: parameters.series("stiffness", [1.0, -1.0]),
        lambda: parameters.span("stiffness", (1.0, -1.0)),
    ):
        with pytest.raises(ValueError, match=message):
            give()
    assert parameters.values({"stiffness": 0.0})[0] == 0.0


def test_an_omega_whose_square_may_be_no_number_is_refused_wherever_it_is_given():
    parameters = ParameterSet({"omega": 1.0})
    for give in (
        lambda: parameters.values({"omega": 1e200}),
        lambda: parameters.series("omega", [1.0, 1e200]),
        lambda: parameters.span("omega", (1e200, 1.0)),
    ):
        with pytest.raises(ValueError, match=r"1e\+200; give one up to 1e\+30, in other units"):
            give()

"""What a system knows about itself: named symmetries, those that are found, angles, and by how much others fail."""

import copy
import functools
import pickle

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hbnlp.aero import flat_plate_re100, thin_airfoil
from hbnlp.systems import chain, duffing, tuned_absorber
from hbnlp.systems.symmetry import LARGEST_GROUP, Symmetry, group
from hbnlp.systems.system import System
from hbnlp.wing.coupling import membrane_wing
from hbnlp.wing.membrane import LinearMembrane, NonlinearMembrane, QuasiLinearMembrane

SWAP = Symmetry([[0, 1], [1, 0]], name="swap")
HALF_SIGN, SIGN, HALF = "half-period sign change", "sign change", "half period"


def names(symmetries):
    return [symmetry.name for symmetry in symmetries]


def pair(*, detuning=0.0, second_load=1.0, to=((1.0, 0.0), (0.0, 1.0)), **options):
    """Two oscillators on a common spring, in coordinates y of q = to @ y."""
    to = np.asarray(to, dtype=float)
    return System(
        to.T @ to,
        0.05 * to.T @ to,
        lambda p: ca.DM(to.T) @ ca.blockcat([[1.0 + p.k, -p.k], [-p.k, 1.0 + p.k + p.detuning]]) @ ca.DM(to),
        nonlinear_force=lambda q, v, tau, p: ca.DM(to.T) @ (ca.DM(to) @ q) ** 3,
        forcing=lambda tau, p: ca.DM(to.T) @ ca.vertcat(p.force * ca.cos(tau), second_load * p.force * ca.cos(tau)),
        parameters={"k": 0.1, "detuning": detuning, "force": 0.2},
        **options,
    )


# -- found by itself ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", [duffing(), chain(4), tuned_absorber()], ids=lambda system: system.name)
def test_odd_forces_under_a_cosine_change_sign_with_half_a_period(system):
    (symmetry,) = system.symmetries_at()
    assert symmetry.name == HALF_SIGN
    np.testing.assert_array_equal(symmetry.matrix, -np.eye(system.n_dof))
    assert symmetry.shift == pytest.approx(np.pi)


@pytest.mark.parametrize("rom", [thin_airfoil(3), flat_plate_re100()], ids=["thin airfoil", "plate"])
@pytest.mark.parametrize(
    "membrane",
    [LinearMembrane(n_modes=3), QuasiLinearMembrane(prestrain=0.01, n_modes=3), NonlinearMembrane(n_modes=3)],
    ids=lambda membrane: type(membrane).__name__,
)
def test_a_wing_has_it_about_zero_incidence_only(membrane, rom):
    wing = membrane_wing(membrane, rom, pitch_axis=0.25)
    moving = {"omega": 2.0, "pitch_amplitude": 0.1, "heave_amplitude": 0.05, "heave_phase": 0.7}
    assert names(wing.symmetries_at(moving)) == [HALF_SIGN]
    assert wing.symmetries_at({**moving, "pitch_mean": 0.02}) == ()
    assert names(wing.symmetries_at({"omega": 2.0})) == [HALF_SIGN, SIGN, HALF]


def test_a_pump_at_twice_the_frequency_leaves_all_three():
    system = System(1.0, 0.1, 1.0, nonlinear_force=lambda q, v, tau, p: [ca.cos(2 * tau) * q[0] + q[0] ** 3])
    assert names(system.symmetries_at()) == [HALF_SIGN, SIGN, HALF]


@pytest.mark.parametrize(
    ("force", "load"),
    [
        (lambda q, v, tau, p: [q[0] ** 3 + 1e-3 * q[0] ** 2], lambda tau, p: [ca.cos(tau)]),
        (lambda q, v, tau, p: [q[0] ** 3], lambda tau, p: [ca.cos(tau) + 1e-3 * ca.cos(2 * tau)]),
        (lambda q, v, tau, p: [q[0] ** 3], lambda tau, p: [ca.cos(tau) + 1e-3]),
        (lambda q, v, tau, p: [q[0] ** 3 * (1 + 0.1 * ca.cos(tau))], lambda tau, p: [ca.cos(tau)]),
        (lambda q, v, tau, p: [1e-3 * v[0] ** 2], lambda tau, p: [ca.cos(tau)]),
        (lambda q, v, tau, p: [ca.log(1 + q[0])], lambda tau, p: [ca.cos(tau)]),
    ],
    ids=["quadratic force", "even load", "static load", "pumped at the frequency", "drag", "defined on one side"],
)
def test_what_is_even_takes_it_away(force, load):
    assert System(1.0, 0.1, 1.0, nonlinear_force=force, forcing=load).symmetries_at() == ()


def test_a_quadratic_term_shows_in_whatever_units():
    """Micrometres in metres: at displacements of 1 the cubic term is 1e9 times the quadratic one, at 1e-6 as 1000."""

    def device(quadratic):
        return System(
            1e-12,
            1e-9,
            1.0,
            nonlinear_force=lambda q, v, tau, p: [1e12 * q[0] ** 3 + quadratic * q[0] ** 2],
            forcing=lambda tau, p: [1e-6 * ca.cos(tau)],
        )

    assert names(device(0.0).symmetries_at()) == [HALF_SIGN]
    assert device(1e3).symmetries_at() == ()


def test_rounding_hides_no_symmetry():
    """The force of two springs that differ near rest by less than their rounding."""

    def spring(x):
        return (1 + x) ** 3 - 1 - 3 * x - 3 * x**2

    system = System(
        np.eye(2),
        0.1 * np.eye(2),
        np.eye(2),
        nonlinear_force=lambda q, v, tau, p: [spring(q[0] - q[1]) + q[0] ** 3, spring(q[1] - q[0]) + q[1] ** 3],
        forcing=lambda tau, p: [ca.cos(tau), ca.cos(tau)],
        symmetries=[SWAP],
    )
    assert names(system.symmetries_at()) == ["swap", HALF_SIGN, "swap with half-period sign change"]


def test_loads_with_jumps_are_as_good_as_smooth_ones():
    square = System(1.0, 0.1, 1.0, forcing=lambda tau, p: [ca.if_else(ca.fmod(tau, 2 * np.pi) < np.pi, 1.0, -1.0)])
    assert names(square.symmetries_at()) == [HALF_SIGN]


# -- named -------------------------------------------------------------------------------------------------------------


def test_a_named_permutation_holds_where_the_parts_are_equal():
    system = pair(symmetries=[SWAP])
    assert names(system.symmetries_at()) == ["swap", HALF_SIGN, "swap with half-period sign change"]
    assert names(system.symmetries_at({"detuning": 1e-3})) == [HALF_SIGN]
    values = system.parameters.values({"omega": 1.0, "detuning": 1e-3})
    assert system.symmetries_at(values) == system.symmetries_at({"detuning": 1e-3})


def test_what_holds_only_together_with_the_sign_is_found():
    """Loads in opposite directions: neither the permutation nor the change of sign, but both."""
    system = pair(second_load=-1.0, symmetries=[Symmetry(-SWAP.matrix, name="antisymmetric swap")])
    assert names(system.symmetries_at()) == [
        "antisymmetric swap",
        HALF_SIGN,
        "antisymmetric swap with half-period sign change",
    ]


def test_a_symmetry_need_not_be_orthogonal_in_the_coordinates_chosen():
    to = np.array([[2.0, 0.3], [-1.0, 0.5]])
    moved = Symmetry(np.linalg.solve(to, SWAP.matrix @ to), name="swap")
    assert not np.allclose(moved.matrix.T @ moved.matrix, np.eye(2))
    assert len(pair(to=to, symmetries=[moved]).symmetries_at()) == 3


def test_a_rotating_load_leaves_rotations_with_a_shift():
    third = 2 * np.pi / 3
    rotation = Symmetry(np.roll(np.eye(3), 1, axis=0), shift=-third, name="rotation")
    system = System(
        np.eye(3),
        0.1 * np.eye(3),
        2.2 * np.eye(3) - 0.2 * np.ones((3, 3)),
        nonlinear_force=lambda q, v, tau, p: q**3 + 0.1 * q**2,
        forcing=lambda tau, p: [ca.cos(tau - k * third) for k in range(3)],
        symmetries=[rotation],
    )
    found = system.symmetries_at()
    assert names(found) == ["rotation", "rotation 2 times"]
    np.testing.assert_allclose([each.shift for each in found], [2 * third, third])
    with pytest.raises(ValueError, match=r"symmetry 'backwards': the load .* misses it by 0\.87 of its terms"):
        system.invariance.check(Symmetry(rotation.matrix, shift=third, name="backwards"))


def test_lag_states_are_judged_by_what_they_do_not_by_their_realisation():
    rng = np.random.default_rng(3)
    basis = rng.normal(size=(4, 4))
    state = np.diag([-1.0, -3.0, -1.0, -3.0])
    drive = np.array([[1.0, 0.0], [0.5, 0.0], [0.0, 1.0], [0.0, 0.5]])
    out = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])

    def damped(out):
        return System(
            np.eye(2),
            0.1 * np.eye(2),
            np.eye(2),
            forcing=lambda tau, p: [ca.cos(tau), ca.cos(tau)],
            lag_state=np.linalg.solve(basis, state @ basis),
            lag_input=np.linalg.solve(basis, drive),
            lag_output=out @ basis,
            symmetries=[SWAP],
        )

    assert len(damped(out).symmetries_at()) == 3
    with pytest.raises(ValueError, match=r"'swap': the transfer function of the lag states at s = .*i misses it by"):
        damped(out * [[1.0], [1.001]])


def test_what_lag_states_pass_on_is_seen_whatever_their_units():
    # driven by the second harmonic through a lag state of a unit thirteen orders smaller
    system = System(
        [[1.0]],
        [[0.1]],
        [[1.0]],
        lag_state=-np.eye(2),
        lag_input=np.zeros((2, 1)),
        lag_motion=np.diag([1e6, 1e-7]),
        lag_output=[[1e-6, 1e7]],
        motion=lambda tau, p: [ca.cos(tau), ca.cos(2 * tau)],
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3],
        parameters={"omega": 1.0},
    )
    assert system.symmetries_at() == ()


def test_lag_states_pass_on_what_moves():
    """Two parts on a shaken support, the second with a lag in what it feels of it."""

    def shaken(second):
        return System(
            np.eye(2),
            0.1 * np.eye(2),
            np.eye(2),
            motion=lambda tau, p: [ca.sin(tau) + 0.2 * ca.sin(2 * tau)],
            input_stiffness=[[1.0], [1.0]],
            lag_state=[[-1.0]],
            lag_input=[[0.0, 0.0]],
            lag_motion=[[1.0]],
            lag_output=[[0.5], [second]],
            symmetries=[SWAP],
        )

    assert names(shaken(0.5).symmetries_at()) == ["swap"]
    with pytest.raises(ValueError, match=r"'swap': the load \(forcing and motion\) misses it by .* harmonic 1\)"):
        shaken(0.4)


# -- errors ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"detuning": 0.1}, r"'swap': stiffness misses it by 0\.091 of its terms \(row 0, column 1\) at k = 0\.1, det"),
        ({"second_load": 0.9}, r"'swap': the load \(forcing and motion\) misses it by .*\(row 0, harmonic 1\)"),
        ({"symmetries": [Symmetry(np.eye(2), shift=1.0, name="later")]}, "'later': the load .* correct its matrix or"),
        ({"symmetries": [Symmetry(np.eye(3))]}, r"'symmetry' has shape \(3, 3\); for this system give .* \(2, 2\)"),
        ({"symmetries": [Symmetry([[0, 2], [0.5, 0]], name="unequal")]}, "'unequal': stiffness misses it by"),
    ],
)
def test_a_symmetry_that_the_system_does_not_have_says_in_what_and_by_how_much(options, message):
    with pytest.raises(ValueError, match=message):
        pair(**{"symmetries": [SWAP], **options})


def test_a_force_that_does_not_go_with_a_symmetry_says_where():
    with pytest.raises(ValueError, match=r"nonlinear_force misses it by .* \(row 1, displacements of size .*, point"):
        System(
            np.eye(2),
            np.eye(2),
            np.eye(2),
            nonlinear_force=lambda q, v, tau, p: [0.0, q[1] ** 3],
            symmetries=[Symmetry([[0, -1], [1, 0]], name="quarter")],
        )


def test_one_symmetry_under_two_names_and_two_under_one_are_refused():
    make = functools.partial(System, np.eye(2), 0.1 * np.eye(2), np.eye(2), parameters={"omega": 1.0})
    swap = Symmetry([[0, 1], [1, 0]], name="swap")
    with pytest.raises(ValueError, match="'swap' and 'exchange' are the same; give it once"):
        make(symmetries=[swap, Symmetry(swap.matrix, name="exchange")])
    with pytest.raises(ValueError, match="two are named 'swap'; give each a name= of its own"):
        make(symmetries=[swap, Symmetry([[1, 0], [0, -1]], name="swap")])


def test_a_shift_in_parts_of_a_period_instead_of_radians_shows_in_the_error():
    with pytest.raises(ValueError, match=r"its shift \(0.5, where 2 pi is a period of the forcing\)"):
        System(
            [[1]],
            [[0.1]],
            [[1]],
            forcing=lambda tau, p: [ca.cos(tau)],
            parameters={"omega": 1.0},
            symmetries=[Symmetry([[-1]], shift=0.5)],
        )


def test_a_group_without_end_is_refused():
    turn = Symmetry([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]], name="turn")
    with pytest.raises(ValueError, match=f"'turn' generate more than {LARGEST_GROUP} elements; give matrices of which"):
        System(np.eye(2), np.eye(2), np.eye(2), symmetries=[turn])


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: Symmetry([[1, 0]]), ValueError, r"'symmetry' has shape \(1, 2\); give a square one, \(n_dof, n_dof\)"),
        (
            lambda: Symmetry([[1, 0], [0, 0]], name="flat"),
            ValueError,
            "'flat' is singular; give one that can be undone",
        ),
        (lambda: Symmetry([[np.nan]]), ValueError, "'symmetry' is not finite"),
        (lambda: Symmetry(1.0, shift=np.inf), ValueError, "shift of symmetry 'symmetry' is inf; give a finite number"),
        (
            lambda: Symmetry(1.0, shift="half"),
            TypeError,
            "shift of symmetry 'symmetry' is 'half'; give a finite number",
        ),
        (lambda: Symmetry(1.0, name=3), TypeError, "name is 3; give a text"),
        (lambda: pair(symmetries=SWAP), TypeError, r"symmetries is Symmetry 'swap'.*; give a list, \[hbnlp.Symmetry"),
        (lambda: pair(symmetries=["swap"]), TypeError, r"symmetries is \['swap'\]; give a list"),
        (lambda: pair(angles="x1"), TypeError, "angles is 'x1'; give a list of names or numbers"),
        (lambda: pair(angles=["x3"]), KeyError, r"unknown displacement 'x3' \(known: x1, x2\)"),
        (lambda: pair(angles=[2]), ValueError, "an entry of angles is 2; give an integer from 0 to 1, or a name"),
        (lambda: pair(angles=["x2"]), ValueError, r"displacement 1 is no angle.*K q \+ nonlinear_force misses it by"),
    ],
)
def test_what_is_given_wrongly_is_named(make, error, message):
    with pytest.raises(error, match=message):
        make()


# -- angles ------------------------------------------------------------------------------------------------------------


def cart(**options):
    """A cart with a pendulum; its matrices do not depend on the angle, as for a light pendulum."""
    return System(
        np.eye(2),
        0.1 * np.eye(2),
        np.diag([1.0, 0.0]),
        nonlinear_force=lambda q, v, tau, p: [q[0] ** 3 + 0.1 * ca.sin(q[1]) * v[1] ** 2, ca.sin(q[1])],
        **options,
    )


def test_angles_are_named_by_displacements_outputs_or_numbers():
    assert cart(angles=["x2"]).angles == (1,)
    assert cart(angles=[1, "x2"]).angles == (1,)
    assert cart(outputs={"position": lambda s: s.q[0], "angle": lambda s: s.q[1]}, angles=["angle"]).angles == (1,)
    assert cart().angles == ()
    with pytest.raises(ValueError, match="displacement 0 is no angle"):
        cart(angles=["x1"])


def test_a_spring_between_angles_lets_them_turn_only_together():
    with pytest.raises(ValueError, match="if angles only turn together, take their differences as coordinates"):
        System(np.eye(2), np.eye(2), [[1, -1], [-1, 1]], nonlinear_force=lambda q, v, tau, p: ca.sin(q), angles=[0, 1])


# -- the record --------------------------------------------------------------------------------------------------------


def test_symmetries_are_equal_by_what_they_do_and_survive_copies():
    again = Symmetry(np.array([[0.0, 1.0], [1.0, -0.0]]) + 1e-13, name="exchange")
    assert again == SWAP
    assert hash(again) == hash(SWAP)
    assert Symmetry(SWAP.matrix, shift=1.0) != SWAP
    assert SWAP != "swap"
    for copied in (pickle.loads(pickle.dumps(SWAP)), copy.deepcopy(SWAP)):  # noqa: S301  our own
        assert copied == SWAP
        assert copied.name == "swap"
    assert Symmetry.identity(3).is_identity
    assert not SWAP.is_identity
    with pytest.raises(ValueError, match="read-only"):
        SWAP.matrix[0, 0] = 1.0
    assert repr(Symmetry(1.0, shift=np.pi, name="later")) == (
        "Symmetry 'later' of 1 degree of freedom, phase shifted by 0.5 periods"
    )


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(4)), st.integers(0, 5))
def test_a_group_is_closed(order, sixths):
    generator = Symmetry(np.eye(4)[list(order)], shift=sixths * np.pi / 3, name="g")
    elements = group([generator], 4)
    assert len(set(elements)) == len(elements)
    known = {*elements, Symmetry.identity(4)}
    for one in elements:
        for other in elements:
            shift = (one.shift + other.shift) % (2 * np.pi)
            shift = 0.0 if 2 * np.pi - shift < 1e-9 else shift
            assert Symmetry(one.matrix @ other.matrix, shift=shift) in known

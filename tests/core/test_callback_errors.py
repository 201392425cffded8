"""What a user's casadi.Callback raises is said in the user's words, wherever it is called from."""

import signal

import casadi as ca
import pytest

import hbnlp


class Table(ca.Callback):
    """A force that is known up to a displacement."""

    def __init__(self, end):
        super().__init__()
        self.end = end
        self.construct("table", {"enable_fd": True})

    def eval(self, arguments):
        if float(arguments[0]) > self.end:
            raise ValueError("the table\nends here")
        return [arguments[0] ** 3]


def system(table):
    return hbnlp.System(
        1.0,
        0.1,
        1.0,
        nonlinear_force=lambda q, v, tau, p: [table(q[0])],
        forcing=lambda tau, p: [0.4 * ca.cos(tau)],
        parameters={"omega": 0.9},
    )


CALLS = {
    "solve": lambda s: hbnlp.solve(hbnlp.HarmonicBalance(s, 3)),
    "IPOPT": lambda s: hbnlp.solve(hbnlp.HarmonicBalance(s, 3), method=hbnlp.Ipopt()),
    "rootfinder": lambda s: hbnlp.solve(hbnlp.HarmonicBalance(s, 3), method=hbnlp.Rootfinder()),
    "search": lambda s: hbnlp.find_all(hbnlp.HarmonicBalance(s, 3)),
    "trace": lambda s: hbnlp.trace(hbnlp.HarmonicBalance(s, 3), "omega", (0.9, 0.95)),
    "integrate": hbnlp.integrate,
}


@pytest.mark.parametrize("end", [-5.0, 0.05])
@pytest.mark.parametrize("call", CALLS)
def test_the_error_names_the_callback_and_says_what_it_said(call, end, capfd):
    table = Table(end)
    with pytest.raises(hbnlp.CallbackError, match=r"casadi.Callback 'table', .*: the table ends here$") as caught:
        CALLS[call](system(table))
    assert isinstance(caught.value.__cause__, RuntimeError)
    assert "ends here" in capfd.readouterr().err


@pytest.mark.parametrize("call", CALLS)
def test_it_does_so_where_interrupts_are_ignored_as_in_the_background_of_a_shell(call):
    table, before = Table(0.05), signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(hbnlp.CallbackError, match="the table ends here"):
            CALLS[call](system(table))
    finally:
        signal.signal(signal.SIGINT, before)


def test_what_was_computed_before_is_kept():
    table = Table(0.5)
    with pytest.raises(hbnlp.TaskError, match="the table ends here") as caught:
        hbnlp.sweep(hbnlp.HarmonicBalance(system(table), 3), "omega", [0.2, 0.3, 0.5, 1.0])
    assert len(caught.value.result) > 0


def test_an_integrator_that_swallows_it_says_where_it_stands():
    table = Table(0.05)
    with pytest.raises(hbnlp.ConvergenceError, match=r"or a casadi.Callback raised an error, .* stderr"):
        hbnlp.integrate(system(table), method=hbnlp.Adaptive())

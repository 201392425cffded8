"""Independent numbers for tests to compare with: direct integration by scipy, nothing of the package but the equations.

What is integrated are the first-order equations of a System, y = (q, q', x)::

    q'' = M^-1 (-K q - D q' + L_x x + load(tau) - f(q, q', tau)),      x' = A x + B q'' + B_u u''

by the explicit Runge-Kutta method of order eight of Dormand and Prince.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

PRECISE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


class FirstOrder:
    """The rate dy/dt of a system at parameter values given by name, and its derivative by y."""

    def __init__(self, system, at):
        self.values = system.parameters.values(at)
        self.omega = float(self.values[system.parameters.index("omega")])
        self.size = system.n_state
        n = system.n_dof
        mass, damping, stiffness, lag_output = system.state_matrices(self.values)
        y, tau = ca.SX.sym("y", self.size), ca.SX.sym("tau")
        q, v, x = y[:n], y[n : 2 * n], y[2 * n :]
        load, drive = system.excitation(tau, self.values)
        force = ca.Function("f", [system.q, system.v, system.tau, system.p], [system.force])(q, v, tau, self.values)
        a = ca.DM(np.linalg.inv(mass)) @ (
            load - force - ca.DM(stiffness) @ q - ca.DM(damping) @ v + ca.DM(lag_output) @ x
        )
        dx = ca.DM(system.lag_state) @ x + ca.DM(system.lag_input) @ a + drive
        rate = ca.densify(ca.vertcat(v, a, dx))
        function = ca.Function("rate", [y, tau], [rate])
        # one call in a few microseconds, on memory that is its own
        self._y, self._tau, self._dy = np.zeros(self.size), np.zeros(1), np.zeros(self.size)
        self._buffer, self._run = function.buffer()
        self._buffer.set_arg(0, memoryview(self._y))
        self._buffer.set_arg(1, memoryview(self._tau))
        self._buffer.set_res(0, memoryview(self._dy))
        self._both = ca.Function("both", [y, tau], [rate, ca.densify(ca.jacobian(rate, y))])

    def __call__(self, t, y):
        self._y[:] = y
        self._tau[0] = self.omega * t
        self._run()
        return self._dy.copy()

    def run(self, y, duration, times=None, **options):
        """The states at the times, (n_state, k), or that at the end."""
        run = solve_ivp(self, (0.0, duration), y, t_eval=times, **{**PRECISE, **options})
        assert run.success
        return run.y if times is not None else run.y[:, -1]

    def monodromy(self, y, duration):
        """The state after ``duration`` and its derivative by the state before: the variational equations."""
        n = self.size

        def rate(t, z):
            f, a = (e.full() for e in self._both(z[:n], self.omega * t))
            return np.concatenate([f.ravel(), (a @ z[n:].reshape(n, n)).ravel()])

        run = solve_ivp(rate, (0.0, duration), np.concatenate([y, np.eye(n).ravel()]), **PRECISE)
        assert run.success
        return run.y[:n, -1], run.y[n:, -1].reshape(n, n)

    def periodic(self, y, periods=1):
        """The periodic state near y by shooting, and its monodromy matrix."""
        duration = 2.0 * np.pi * periods / self.omega
        for _ in range(20):
            end, matrix = self.monodromy(y, duration)
            step = np.linalg.solve(matrix - np.eye(self.size), end - y)
            y = y - step
            if np.linalg.norm(step) <= 1e-10 * (1e-10 + np.linalg.norm(y)):
                return y, self.monodromy(y, duration)[1]
        raise AssertionError("shooting does not converge")


def state(solution):
    """The state (q, q') of a solution of a system without lag states at t = 0."""
    return np.concatenate([solution.displacement([0.0])[:, 0], solution.velocity([0.0])[:, 0]])


def multipliers(matrix):
    """The eigenvalues by falling modulus."""
    values = np.linalg.eigvals(matrix)
    return values[np.argsort(-np.abs(values))]

"""Independent numbers for tests to compare with: harmonic balance with cubic springs in numpy, nothing of the package.

Folds and points where two branches touch are solutions of extended systems by Newton's method; the starts may come from
anywhere, as what is solved does not depend on them.
"""

from __future__ import annotations

import numpy as np


class CubicBalance:
    """Harmonic balance in numpy alone: M x'' + C x' + K x + sum_j g_j d_j (d_j . x)^3 = F b cos w t, d_j the springs.

    Unknowns are the coefficients 1, cos, sin, cos 2, ... of every degree of freedom in turn, as the package's are. The
    cubes are taken at samples that resolve them exactly, and all derivatives by hand.
    """

    def __init__(self, mass, damping, stiffness, springs, cubic, load, n_harmonics):
        self.mass, self.damping, self.stiffness = (np.atleast_2d(m).astype(float) for m in (mass, damping, stiffness))
        self.springs, self.cubic, m = np.atleast_2d(springs).astype(float), np.atleast_1d(cubic), 2 * n_harmonics + 1
        n_samples = 8 * n_harmonics + 8
        tau = 2.0 * np.pi * np.arange(n_samples) / n_samples
        waves = [wave(k * tau) for k in range(1, n_harmonics + 1) for wave in (np.cos, np.sin)]
        self.sample = np.column_stack([np.ones(n_samples), *waves])
        self.project = self.sample.T * (2.0 / n_samples)
        self.project[0] /= 2.0
        self.rate = np.zeros((m, m))
        for k in range(1, n_harmonics + 1):
            self.rate[2 * k - 1, 2 * k], self.rate[2 * k, 2 * k - 1] = k, -k
        self.load = np.kron(np.atleast_1d(load), np.eye(m)[1])
        self.shape = (len(self.mass), m)

    def linear(self, w):
        return (
            np.kron(self.mass, w**2 * self.rate @ self.rate)
            + np.kron(self.damping, w * self.rate)
            + np.kron(self.stiffness, np.eye(self.shape[1]))
        )

    def linear_by_omega(self, w):
        return np.kron(self.mass, 2.0 * w * self.rate @ self.rate) + np.kron(self.damping, self.rate)

    def stretch(self, x):
        return self.springs @ x.reshape(self.shape) @ self.sample.T

    def residual(self, x, w, force):
        cubes = (self.springs.T * self.cubic) @ (self.stretch(x) ** 3 @ self.project.T)
        return self.linear(w) @ x + cubes.ravel() - force * self.load

    def springs_by_x(self, factors):
        """The derivative of the cubes' coefficients, ``factors`` the derivatives of the cubes at the samples."""
        return sum(
            g * np.kron(np.outer(d, d), self.project @ (factor[:, np.newaxis] * self.sample))
            for g, d, factor in zip(self.cubic, self.springs, factors, strict=True)
        )

    def jacobian(self, x, w):
        return self.linear(w) + self.springs_by_x(3.0 * self.stretch(x) ** 2)

    def solve(self, x, w, force):
        """The solution near x."""

        def system(x):
            return self.residual(x, w, force), self.jacobian(x, w)

        return _newton(system, np.asarray(x, dtype=float))

    def fold(self, x, w, force):
        """The frequency and solution of the fold near x, by R = 0, R_x v = 0, v . v = 1 in x, v and w."""
        n, x = len(x), np.asarray(x, dtype=float)

        def system(z):
            x, v, w = z[:n], z[n:-1], z[-1]
            jacobian, by_omega = self.jacobian(x, w), self.linear_by_omega(w)
            bent = self.springs_by_x(6.0 * self.stretch(x) * self.stretch(v))
            matrix = np.block(
                [
                    [jacobian, np.zeros((n, n)), (by_omega @ x)[:, np.newaxis]],
                    [bent, jacobian, (by_omega @ v)[:, np.newaxis]],
                    [np.zeros((1, n)), 2.0 * v[np.newaxis], np.zeros((1, 1))],
                ]
            )
            return np.concatenate([self.residual(x, w, force), jacobian @ v, [v @ v - 1.0]]), matrix

        null = np.linalg.svd(self.jacobian(x, w))[2][-1]
        z = _newton(system, np.concatenate([x, null, [w]]))
        return z[-1], z[:n]

    def touching(self, x, w, force):
        """Force and frequency where two branches touch near x: R = 0, psi R_x = 0, psi . R_w = 0, psi . psi = 1."""
        n = len(x)

        def equations(z):
            x, psi, w, force = z[:n], z[n:-2], z[-2], z[-1]
            ends = [psi @ self.linear_by_omega(w) @ x, psi @ psi - 1.0]
            return np.concatenate([self.residual(x, w, force), self.jacobian(x, w).T @ psi, ends])

        def system(z):
            steps = 1e-6 * np.eye(z.size)
            return equations(z), np.array([(equations(z + e) - equations(z - e)) / 2e-6 for e in steps]).T

        psi = np.linalg.svd(self.jacobian(x, w))[0][:, -1]
        z = _newton(system, np.concatenate([x, psi, [w, force]]))
        return z[-1], z[-2]


def _newton(system, z):
    for _ in range(60):
        values, matrix = system(z)
        step = np.linalg.solve(matrix, values)
        z = z - step
        if np.abs(step).max() <= 1e-11 * np.abs(z).max():
            return z
    raise AssertionError("Newton's method does not converge")


def absorber_balance(n_harmonics):
    """The host with its absorber of `hbnlp.systems.tuned_absorber`, from the numbers of its source."""
    c1, c2, k2, eps, knl2 = 0.002, 0.0127558546415, 0.0453506255416, 0.05, 0.0041666666667
    tie = np.array([[1.0, -1.0], [-1.0, 1.0]])
    host = np.diag([1.0, 0.0])
    springs = [[1.0, 0.0], [1.0, -1.0]]
    return CubicBalance(
        np.diag([1.0, eps]), c1 * host + c2 * tie, host + k2 * tie, springs, [1.0, knl2], [1, 0], n_harmonics
    )

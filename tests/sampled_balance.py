"""Harmonic balance of a random oscillator in numpy alone: samples of the equation of motion, projected.

Derivatives of the force by complex steps, those of the lag states in closed form; folds by Newton's method on
R = 0, R_x w = 0, w . w = 1. Coefficients as the package's: 1, cos, sin, cos 2, ... of every displacement in turn.
"""

from __future__ import annotations

import numpy as np

N_SAMPLES = 1024
MOST_SAMPLES = 2**17
ALIASING = 1e-10
"""Twice the samples move the residual by no more, relative to its terms, where they are enough for a force."""
TINY_STEP = 1e-30


class SampledBalance:
    def __init__(self, oscillator, n_samples=N_SAMPLES):
        self.oscillator, self.h = oscillator, oscillator.n_harmonics
        (self.mass, self.damping, self.stiffness), self.lags = oscillator.scaled
        self.n, self.m = len(self.mass), 2 * self.h + 1
        self.tau = 2.0 * np.pi * np.arange(n_samples) / n_samples
        self.waves = self.waves_at(self.tau)
        self.project = self.waves.T * (2.0 / n_samples)
        self.project[0] /= 2.0
        self.rate = np.zeros((self.m, self.m))  # the coefficients of d/dtau, from the right
        for k in range(1, self.h + 1):
            self.rate[2 * k - 1, 2 * k], self.rate[2 * k, 2 * k - 1] = k, -k
        self.load = np.array([row + 0.0 * self.tau for row in oscillator.load_rows(self.tau, np)])

    def resolving(self, x, w):
        """Return the balance with as many samples as the force takes on a motion, this one if it has them."""
        balance = self
        while len(balance.tau) < MOST_SAMPLES:
            finer = SampledBalance(self.oscillator, 2 * len(balance.tau))
            moved = np.abs(finer.residual(x, w) - balance.residual(x, w)).max()
            if moved <= ALIASING * max(finer.term_size(x, w), 1e-300):
                return balance
            balance = finer
        return balance

    def waves_at(self, tau):
        tau = np.atleast_1d(tau)
        each = [wave(k * tau) for k in range(1, self.h + 1) for wave in (np.cos, np.sin)]
        return np.column_stack([np.ones(tau.size), *each])

    def linear(self, w):
        """The matrix of the linear terms on the coefficients of all displacements in turn."""
        matrix = (
            np.kron(self.mass, w**2 * self.rate @ self.rate)
            + np.kron(self.damping, w * self.rate)
            + np.kron(self.stiffness, np.eye(self.m))
        )
        a, b, out = self.lags
        for k in range(1, self.h + 1):
            if len(a):
                # L_x (i k w - A)^-1 B (-k^2 w^2), of q_k = a_cos - i a_sin
                z = out @ np.linalg.solve(1j * k * w * np.eye(len(a)) - a, b) * (-((k * w) ** 2))
                stay, turn, c, s = np.zeros((self.m, self.m)), np.zeros((self.m, self.m)), 2 * k - 1, 2 * k
                stay[c, c] = stay[s, s] = 1.0
                turn[c, s], turn[s, c] = 1.0, -1.0
                matrix = matrix - np.kron(z.real, stay) - np.kron(z.imag, turn)
        return matrix

    def motion(self, x, w):
        a = x.reshape(self.n, self.m)
        return a @ self.waves.T, w * (a @ self.rate.T) @ self.waves.T

    def lag_states(self, x, w):
        """The lag states at t = 0."""
        a, b, _ = self.lags
        q = x.reshape(self.n, self.m)
        total = np.zeros(len(a))
        for k in range(1, self.h + 1):
            amplitude = q[:, 2 * k - 1] - 1j * q[:, 2 * k]
            total += np.linalg.solve(1j * k * w * np.eye(len(a)) - a, b @ amplitude * (-((k * w) ** 2))).real
        return total

    def state(self, x, w):
        a = x.reshape(self.n, self.m)
        first = self.waves_at(0.0)[0]
        return np.concatenate([a @ first, w * (a @ self.rate.T) @ first, self.lag_states(x, w)])

    def force(self, q, v, tau):
        return np.array(self.oscillator.force_rows(q, v, tau, np))

    def slopes(self, q, v, tau):
        """df/dq and df/dv at samples, (n, n, samples) each."""
        parts = []
        for which in (0, 1):
            columns = []
            for j in range(self.n):
                moved = [q.astype(complex), v.astype(complex)]
                size = self.oscillator.units[0] / (self.oscillator.units[1] if which else 1.0)
                moved[which][j] = moved[which][j] + 1j * TINY_STEP * size
                columns.append(self.force(*moved, tau).imag / (TINY_STEP * size))
            parts.append(np.array(columns).swapaxes(0, 1))
        return parts

    def terms(self, x, w):
        """The terms whose sum is the residual."""
        return [
            self.linear(w) @ x,
            (self.force(*self.motion(x, w), self.tau) @ self.project.T).ravel(),
            -(self.load @ self.project.T).ravel(),
        ]

    def residual(self, x, w):
        return sum(self.terms(x, w))

    def term_size(self, x, w):
        a = np.abs(x.reshape(self.n, self.m)).max()
        scale = np.abs(self.stiffness).max() + w**2 * np.abs(self.mass).max()
        return max(scale * a, *(np.abs(term).max() for term in self.terms(x, w)))

    def left_out(self, x, w):
        """The force beyond the harmonics, relative to the terms: what the truncation leaves out."""
        f = self.force(*self.motion(x, w), self.tau) - self.load
        rest = f - (f @ self.project.T) @ self.waves.T
        return np.abs(rest).max() / max(self.term_size(x, w), 1e-300)

    def jacobian(self, x, w):
        by_q, by_v = self.slopes(*self.motion(x, w), self.tau)
        rates = w * self.waves @ self.rate
        matrix = self.linear(w)
        blocks = matrix.reshape(self.n, self.m, self.n, self.m)
        for i in range(self.n):
            for j in range(self.n):
                if by_q[i, j].any() or by_v[i, j].any():
                    inner = by_q[i, j][:, None] * self.waves + by_v[i, j][:, None] * rates
                    blocks[i, :, j, :] += self.project @ inner
        return matrix

    def fold(self, x, w, steps=12):
        """Omega at the fold near (x, w), or None where Newton's method does not get there."""
        length, _, force = self.oscillator.units
        size, rows, n = max(np.abs(x).max(), 1e-6 * length), force / length, x.size
        null = np.linalg.svd(self.jacobian(x, w))[2][-1]
        for _ in range(steps):
            jacobian = self.jacobian(x, w)
            h = 1e-5
            bent = (self.jacobian(x + h * size * null, w) - self.jacobian(x - h * size * null, w)) / (2.0 * h)
            dw = 1e-6 * w
            by_w = (self.residual(x, w + dw) - self.residual(x, w - dw)) / (2e-6 * size)
            slope = (self.jacobian(x, w + dw) - self.jacobian(x, w - dw)) @ null / 2e-6
            matrix = np.block(
                [
                    [jacobian / rows, np.zeros((n, n)), by_w[:, None] / rows],
                    [bent / rows, jacobian / rows, slope[:, None] / rows],
                    [np.zeros((1, n)), 2.0 * null[None], np.zeros((1, 1))],
                ]
            )
            values = np.concatenate([self.residual(x, w) / (rows * size), jacobian @ null / rows, [null @ null - 1.0]])
            step = np.linalg.solve(matrix, values)
            x, null, w = x - size * step[:n], null - step[n:-1], w * (1.0 - step[-1])
            if not np.isfinite(step).all():
                return None
            if np.abs(step[-1]) < 1e-10 and np.abs(step).max() < 1e-6:
                return w
        return None

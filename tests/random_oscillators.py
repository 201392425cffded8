"""Random forced oscillators, each made of a seed: the same equations for CasADi and for numpy.

The equation is, in units of its own::

    M q'' + D q' + K q + f(q, q', tau) = L_x x + preload + amplitude_1 cos tau + amplitude_2 cos(k tau + phase)
    x' = A x + B q''

whose force f sums some of the terms in `TERMS`. A term is written once, in the functions (`cos`, `tanh`, `sqrt`) that
CasADi and numpy have under the same names.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import hbnlp


def spring(rng):
    """Stiffness of degree 2 to 5, softening as often as hardening where the degree is odd."""
    degree, size = int(rng.integers(2, 6)), rng.uniform(0.02, 0.3)
    size *= rng.choice([-0.3, 1.0]) if degree == 3 else 1.0 if degree == 5 else rng.choice([-0.5, 0.5])
    return lambda q, v, tau, xp: size * q**degree + 0.05 * q**5 * (degree < 5)


def double_well(rng):
    depth, cubic = rng.uniform(1.1, 2.0), rng.uniform(0.3, 1.0)
    return lambda q, v, tau, xp: -depth * q + cubic * q**3


def cubed_velocity(rng):
    size = rng.uniform(0.01, 0.3)
    return lambda q, v, tau, xp: size * v**3


def self_exciting(rng):
    size = rng.uniform(0.05, 0.3)
    return lambda q, v, tau, xp: -size * (1.0 - q**2) * v


def pumping(rng):
    depth, multiple = rng.uniform(0.02, 0.5), int(rng.integers(1, 3))
    return lambda q, v, tau, xp: depth * xp.cos(multiple * tau) * q + 0.1 * q**3


def friction(rng):
    size, width = rng.uniform(0.02, 0.3), 10.0 ** rng.uniform(-1.0, 0.0)
    return lambda q, v, tau, xp: size * xp.tanh(v / width)


def gap(rng):
    """A stop of stiffness k beyond a gap, its edge rounded over a width."""
    k, at, width = rng.uniform(0.3, 5.0), rng.uniform(0.1, 1.0), 10.0 ** rng.uniform(-1.5, -0.5)
    return lambda q, v, tau, xp: 0.5 * k * (q - at + xp.sqrt((q - at) ** 2 + width**2))


TERMS = {
    "spring": spring,
    "double well": double_well,
    "cubed velocity": cubed_velocity,
    "self-exciting": self_exciting,
    "pumping": pumping,
    "friction": friction,
    "gap": gap,
}


@dataclass(frozen=True)
class RandomOscillator:
    """The equation of motion of a seed, as numbers and as a `hbnlp.System`.

    ``units`` are those of length, time and force in which it is given to hbnlp; all else of this class is in them too.
    """

    seed: int
    n_harmonics: int
    units: tuple[float, float, float]
    matrices: tuple[np.ndarray, np.ndarray, np.ndarray]
    lags: tuple[np.ndarray, np.ndarray, np.ndarray]
    terms: tuple = field(repr=False)
    names: tuple[str, ...]
    load: tuple[np.ndarray, np.ndarray, np.ndarray, int, float]
    span: tuple[float, float]

    @classmethod
    def of(cls, seed: int) -> RandomOscillator:
        rng = np.random.default_rng(seed)
        n = int(rng.choice([1, 1, 1, 1, 2, 2, 2, 3, 3, 4, 5, 6]))
        n_harmonics = int(rng.choice([1, 2, 3, 3, 5, 5, 5, 7, 7, 9, 13, 25]))
        low = rng.uniform(0.4, 1.2)
        high = low + rng.uniform(0.3, 0.9)
        modes = np.linalg.qr(rng.standard_normal((n, n)))[0]
        root = np.diag(rng.uniform(0.7, 1.3, n))
        stiffness = root @ modes @ np.diag(rng.uniform(0.5, 2.0, n) ** 2) @ modes.T @ root
        mass, damping = root @ root, 10.0 ** rng.uniform(-2.3, -0.8) * root @ root + rng.uniform(0.0, 0.02) * stiffness
        terms, names = [], []
        for _ in range(int(rng.integers(1, 4))):
            name = str(rng.choice(list(TERMS)))
            direction = np.zeros(n)
            direction[int(rng.integers(n))] = 1.0
            if n > 1 and rng.random() < 0.5:  # between two masses
                direction[int(rng.integers(n))] -= 1.0
            if direction.any():
                terms.append((direction, TERMS[name](rng)))
                names.append(name)
        m = int(rng.choice([0, 0, 0, 1, 2]))
        lags = -np.diag(rng.uniform(0.2, 2.0, m)), rng.uniform(-0.5, 0.5, (m, n)), rng.uniform(-0.2, 0.2, (n, m))
        amplitude = 10.0 ** rng.uniform(-1.3, 0.3) * rng.standard_normal(n) * (rng.random() > 0.1)
        second = 0.5 * amplitude * (rng.random() < 0.4)
        preload = 0.3 * rng.standard_normal(n) * (rng.random() < 0.25)
        load = preload, amplitude, second, int(rng.integers(2, 4)), float(rng.uniform(0.0, 6.0))
        units = (1.0, 1.0, 1.0) if rng.random() < 0.7 else tuple(10.0 ** rng.uniform(-8.0, 8.0, 3))
        span = (low / units[1], high / units[1])
        return cls(
            seed=seed,
            n_harmonics=n_harmonics,
            units=units,
            matrices=(mass, damping, stiffness),
            lags=lags,
            terms=tuple(terms),
            names=tuple(names),
            load=load,
            span=span if rng.random() < 0.5 else span[::-1],
        )

    def __repr__(self) -> str:
        n, m = self.lags[2].shape
        units = "" if self.units == (1.0, 1.0, 1.0) else ", units of {:.0e}, {:.0e}, {:.0e}".format(*self.units)
        kinds = ", ".join(self.names) or "linear"
        return f"seed {self.seed}: {n} dof, {m} lags, H = {self.n_harmonics}, {kinds}{units}"

    @property
    def scaled(self):
        """M, D, K and A, B, L_x in the units."""
        length, time, force = self.units
        mass, damping, stiffness = (
            m * (force / length * time**k) for m, k in zip(self.matrices, (2, 1, 0), strict=True)
        )
        a, b, out = self.lags
        return (mass, damping, stiffness), (a / time, b, out * (force * time / length))

    def force_rows(self, q, v, tau, xp):
        """The n components of f; q and v by component, numbers, samples or symbols alike."""
        length, time, force = self.units
        rows = [0.0 * q[i] for i in range(len(self.lags[2]))]
        for direction, term in self.terms:
            ends = np.flatnonzero(direction)
            stretch = sum(float(direction[i]) * q[int(i)] for i in ends) / length
            rate = sum(float(direction[i]) * v[int(i)] for i in ends) * (time / length)
            value = force * term(stretch, rate, tau, xp)
            for i in ends:
                rows[i] = rows[i] + float(direction[i]) * value
        return rows

    def load_rows(self, tau, xp):
        preload, first, second, k, phase = self.load
        force = self.units[2]
        return [
            force * (float(a) + float(b) * xp.cos(tau) + float(c) * xp.cos(k * tau + phase))
            for a, b, c in zip(preload, first, second, strict=True)
        ]

    def problem(self) -> hbnlp.HarmonicBalance:
        (mass, damping, stiffness), (a, b, out) = self.scaled
        lags = {"lag_state": a, "lag_input": b, "lag_output": out} if len(a) else {}
        system = hbnlp.System(
            mass,
            damping,
            stiffness,
            nonlinear_force=lambda q, v, tau, p: self.force_rows(q, v, tau, ca),
            forcing=lambda tau, p: self.load_rows(tau, ca),
            name=f"random {self.seed}",
            **lags,
        )
        return hbnlp.HarmonicBalance(system, self.n_harmonics)

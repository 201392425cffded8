"""Check the shipped flat-plate response and ROM against theory, and the wing for stability; print and draw.

python benchmarks/validation/flat_plate/check_rom.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from hbnlp.aero import AeroROM, flat_plate_re100, flat_plate_re100_response

INVISCID = {1: 1.709261, 2: 0.718468, 3: 0.471274}
PICTURES = Path(__file__).parents[3] / "docs" / "_static" / "linear_flow"


def main() -> None:
    response = flat_plate_re100_response()
    print(f"C_D {response.provenance['drag']:.5f} (triple deck .3606)")
    print(f"C_L per rad {response.static[0, 0]:.4f}, per W_1 {response.static[0, 2]:.4f}")
    print(f"static heave: largest load {np.abs(response.static[:, 1]).max():.1e}")
    expected = -response.static[:, 0]
    expected[0] -= response.provenance["drag"]
    for index in (0, 5, 10):
        velocity = (response.values[index, :, 1] / (1j * response.omega[index])).real
        difference = np.linalg.norm(velocity - expected) / np.linalg.norm(expected)
        print(f"heave velocity against minus pitch at omega {response.omega[index]:.4f}: {difference:.2e}")
    high = response.omega >= 200.0
    root = response.omega[high] ** -0.5
    for k, exact in INVISCID.items():
        mass = -(response.values[high, k, k + 1] / (1j * response.omega[high]) ** 2).real
        limit = np.polyfit(root, mass, 1)[1]
        print(f"added mass M_{k}{k}: {limit:.5f} extrapolated, {exact:.5f} inviscid, {limit / exact - 1:+.2%}")
    tensions = (0.5, 0.7, 1.0, 2.0, 4.0, 20.0, 100.0, 400.0)
    for name, rom in (("reduced", flat_plate_re100()), ("full", flat_plate_re100(full=True))):
        print(f"{name}: {rom.n_lags} lag states, error {rom.provenance.fit_error:.2e}")
        for c_T in tensions:
            values = np.linalg.eigvals(wing_matrix(rom, c_T))
            fast = values[np.abs(values.imag) > 0.5]
            worst = fast[np.argmax(fast.real / np.abs(fast))]
            print(f"  c_T {c_T:6.1f}: rightmost {values.real.max():+.4f}, least damped oscillation {worst:.4f}")
    for n in (1, 3, 5, 10, 15, 20):
        for full in (False, True):
            rom = flat_plate_re100(n, full=full)
            values = np.concatenate([np.linalg.eigvals(wing_matrix(rom, c_T)) for c_T in tensions])
            fast = values[np.abs(values.imag) > 0.5]
            added = np.linalg.eigvalsh(-0.5 * (rom.mass[1:, 2:] + rom.mass[1:, 2:].T)).min()
            print(
                f"{n} modes, {'full' if full else 'reduced'}: rightmost {values.real.max():+.4f}, least damping "
                f"{-(fast.real / np.abs(fast)).max():.4f}, least eigenvalue of the added mass {added:.4f}"
            )
    draw_resonance()


def wing_matrix(rom: AeroROM, c_T: float, mu: float = 0.5) -> np.ndarray:
    """Return the state matrix of (W, W', x) of the wing with linear membrane and fixed incidence."""
    n, lags = rom.n_modes, rom.n_lags
    k = np.arange(1, n + 1)
    mass = 2.0 * mu * np.eye(n) - rom.mass[1:, 2:]
    stiffness = np.diag(k**2 * np.pi**2 * c_T) - rom.stiffness[1:, 2:]
    acceleration = np.linalg.solve(mass, np.hstack([-stiffness, rom.damping[1:, 2:], rom.lag_output[1:]]))
    top = np.hstack([np.zeros((n, n)), np.eye(n), np.zeros((n, lags))])
    lag = np.hstack([np.zeros((lags, 2 * n)), rom.lag_state]) + rom.lag_input[:, 2:] @ acceleration
    return np.vstack([top, acceleration, lag])


def lift_response(rom: AeroROM, c_T: float, omega: np.ndarray, mu: float = 0.5) -> np.ndarray:
    """Return |C_L| per pitch acceleration of the wing with linear membrane."""
    k = np.arange(1, rom.n_modes + 1)
    inertia = 4.0 * mu * (-1.0) ** (k + 1) / (k * np.pi)
    gain = []
    for w, g in zip(omega, rom.transfer(1j * omega), strict=True):
        dynamic = np.diag(k**2 * np.pi**2 * c_T - 2.0 * mu * w**2) - g[1:, 2:]
        modes = np.linalg.solve(dynamic, g[1:, 0] - w**2 * inertia)
        gain.append(abs(g[0, 0] + g[0, 2:] @ modes) / w**2)
    return np.array(gain)


def draw_resonance() -> None:
    omega = np.geomspace(0.3, 30.0, 600)
    figure, ax = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for c_T in (0.5, 1.0, 2.0, 4.0):
        full = lift_response(flat_plate_re100(full=True), c_T, omega)
        reduced = lift_response(flat_plate_re100(), c_T, omega)
        (line,) = ax.semilogx(omega, 20 * np.log10(full), label=f"c_T = {c_T:g}")
        ax.semilogx(omega, 20 * np.log10(reduced), ":", color=line.get_color(), linewidth=2.5)
        print(f"c_T {c_T:g}: reduced against full lift response {np.abs(reduced / full - 1).max():.2e}")
    rigid = np.abs(flat_plate_re100(full=True).transfer(1j * omega)[:, 0, 0]) / omega**2
    ax.semilogx(omega, 20 * np.log10(rigid), "k--", label="rigid")
    ax.set_xlabel("omega c/U")
    ax.set_ylabel("|C_L| / |alpha''|, dB")
    ax.set_title("Lift response of the linear wing, mu = 0.5: full ROM (lines), reduced (dots)")
    ax.legend()
    ax.grid(visible=True, alpha=0.3)
    PICTURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURES / "lift_response.png", dpi=90)


if __name__ == "__main__":
    main()

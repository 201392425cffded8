"""The shape of a wing and of other systems in motion: pictures, and films of each format."""

import html.parser
import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

import hbnlp
from hbnlp.systems import chain


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def membrane():
    return hbnlp.QuasiLinearMembrane(prestrain=0.02, n_modes=3)


@pytest.fixture(scope="module")
def flying(membrane):
    """A wing that pitches about the quarter chord and heaves."""
    motion = {"pitch_amplitude": 0.05, "pitch_mean": 0.02, "heave_amplitude": 0.03, "heave_phase": 0.4}
    wing = hbnlp.membrane_wing(membrane, hbnlp.aero.flat_plate_re100(), pitch_axis=0.25, parameters=motion)
    return hbnlp.solve(hbnlp.HarmonicBalance(wing, 3), at={"omega": 1.2})


@pytest.fixture(scope="module")
def masses():
    return hbnlp.solve(hbnlp.HarmonicBalance(chain(3), 3), at={"omega": 0.8})


def times(solution, n):
    return 2.0 * np.pi / solution.omega * np.linspace(0.0, solution.periods, n, endpoint=False)


def test_shapes_of_a_wing_are_the_membrane_s_at_equal_steps_of_a_period(flying, membrane):
    ax = flying.plot_shape(n_shapes=5)
    *shapes, mean = ax.get_lines()
    expected = membrane.displacement(flying.displacement(times(flying, 5)), shapes[0].get_xdata())
    np.testing.assert_allclose(np.transpose([line.get_ydata() for line in shapes]), expected, atol=1e-15)
    steady = membrane.displacement(flying.coefficients[:, :1], mean.get_xdata())[:, 0]
    np.testing.assert_allclose(mean.get_ydata(), steady, atol=1e-12)


def test_in_space_the_leading_edge_heaves_and_the_pitch_axis_does_not_move_with_pitch(flying):
    lines = flying.plot_shape(n_shapes=4, in_space=True).get_lines()[:-1]
    own = flying.plot_shape(n_shapes=4).get_lines()[:-1]
    t = times(flying, 4)
    p = flying.parameters
    heave = p["heave_amplitude"] * np.sin(p["omega"] * t + p["heave_phase"])
    for k, (moved, still) in enumerate(zip(lines, own, strict=True)):
        x, rigid = moved.get_xdata(), moved.get_ydata() - still.get_ydata()
        assert rigid[0] == pytest.approx(flying.signal("z", t[k : k + 1])[0])
        assert np.interp(0.25, x, rigid) == pytest.approx(heave[k])  # nose up: what is behind the axis goes down
        assert rigid[0] - rigid[-1] == pytest.approx(flying.signal("alpha", t[k : k + 1])[0])


def test_the_masses_of_a_chain_are_drawn_beside_each_other_and_a_beam_by_its_modes(masses):
    first = masses.plot_shape(n_shapes=3).get_lines()[0]
    np.testing.assert_array_equal(first.get_xdata(), [1, 2, 3])
    np.testing.assert_allclose(first.get_ydata(), masses.displacement([0.0])[:, 0])
    beam = masses.plot_shape(modes=lambda x: np.stack([x**2, x**3, x**4], axis=1), n_shapes=3).get_lines()[0]
    assert beam.get_ydata()[-1] == pytest.approx(masses.displacement([0.0]).sum())
    with pytest.raises(ValueError, match=r"modes\(x\) .*\(201, 3\)"):
        masses.plot_shape(modes=lambda x: x)
    with pytest.raises(ValueError, match="only a membrane wing has pitch and heave"):
        masses.plot_shape(in_space=True)


def test_a_gif_has_a_picture_for_each_frame_and_none_is_like_the_next(flying, tmp_path):
    flying.animate(tmp_path / "wing.gif", in_space=True, n_frames=4)
    assert plt.get_fignums() == []
    with Image.open(tmp_path / "wing.gif") as film:
        assert film.n_frames == 4
        assert film.info["duration"] == 50
        pictures = []
        for k in range(4):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB"), dtype=int))
    assert all(np.abs(a - b).max() > 100 for a, b in zip(pictures, np.roll(pictures, 1, axis=0), strict=True))
    assert [each.name for each in tmp_path.iterdir()] == ["wing.gif"]


def test_a_page_holds_all_its_pictures_and_asks_no_network(masses, tmp_path):
    masses.animate(tmp_path / "chain.html", n_frames=3, output="x2")
    page = (tmp_path / "chain.html").read_text(encoding="utf-8")
    pictures = json.loads(re.search(r"const pictures = (\[.*\]);", page)[1])
    assert len({*pictures}) == 3
    assert all(picture.startswith("iVBOR") for picture in pictures)
    assert "http" not in re.sub(r"\[\".*\"\]", "", page)
    html.parser.HTMLParser().feed(page)


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_an_mp4_is_one(masses, tmp_path):
    masses.animate(tmp_path / "chain.mp4", n_frames=3)
    assert (tmp_path / "chain.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_film_that_cannot_be_made_says_why(masses, tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(ValueError, match=r"ffmpeg, which is not found, for \.mp4: install it"):
        masses.animate(tmp_path / "chain.mp4")
    with pytest.raises(ValueError, match=r"a name that ends in \.gif, \.mp4 or \.html"):
        masses.animate(tmp_path / "chain.avi")
    with pytest.raises(KeyError, match="unknown output 'C_L'"):
        masses.animate(tmp_path / "chain.gif", output="C_L")
    with pytest.raises(hbnlp.SaveError):
        masses.animate(tmp_path / "nowhere" / "chain.gif", n_frames=2)
    assert [*tmp_path.iterdir()] == []

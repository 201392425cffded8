"""A page of the gallery shows one whole figure, and an example that fails or warns ends the build of the pages."""

import subprocess
import sys
import types
from pathlib import Path

import gallery_pages
import pytest
from matplotlib import pyplot as plt
from sphinx.errors import ConfigError, ExtensionError
from sphinx_gallery.scrapers import ImagePathIterator

DOCS = Path(__file__).parents[1] / "docs"
SAVED = 'figure.savefig("some.png")'


@pytest.fixture(autouse=True)
def _no_figure_is_left_open():
    yield
    plt.close("all")


def scrape(folder, content=SAVED):
    """Return what a page shows after a block of code, with the figures that are open now."""
    block = types.SimpleNamespace(type="code", content=content, lineno=17)
    images = ImagePathIterator(str(folder / "some_{0:03}.png"))
    block_vars = {"src_file": str(folder / "some_example.py"), "image_path_iterator": images}
    conf = {"src_dir": str(folder), "image_srcset": [], "matplotlib_animations": (False, None), "compress_images": []}
    return gallery_pages.whole_figure(block, block_vars, conf)


def test_a_whole_figure_is_shown_and_closed(tmp_path):
    _, (left, right) = plt.subplots(1, 2)
    left.plot([1.0, 2.0])
    right.imshow([[1.0, 2.0]])
    assert "some_001.png" in scrape(tmp_path)
    assert (tmp_path / "some_001.png").stat().st_size > 1_000
    assert plt.get_fignums() == []


def test_a_block_without_a_figure_shows_none(tmp_path):
    assert scrape(tmp_path, "x = 1") == ""


def test_axes_without_data_are_refused_with_the_name_of_the_example(tmp_path):
    _, (left, right) = plt.subplots(1, 2)
    left.plot([1.0, 2.0])
    right.set(title="drawn in a later block", xlabel="x")
    with pytest.raises(ExtensionError, match=r"some_example\.py, .*line 17 on.* 1 'drawn in a later block'"):
        scrape(tmp_path)


def test_a_figure_without_axes_is_refused(tmp_path):
    plt.figure()
    with pytest.raises(ExtensionError, match=r"some_example\.py.*the figure has 0 axes"):
        scrape(tmp_path)


def test_a_figure_that_is_not_saved_where_it_is_drawn_is_refused(tmp_path):
    plt.subplots()[1].plot([1.0, 2.0])
    with pytest.raises(ExtensionError, match=r"some_example\.py.*1 figures are open at its end, expected 0"):
        scrape(tmp_path, "ax.plot([1.0, 2.0])")


def test_a_second_figure_or_none_is_refused(tmp_path):
    with pytest.raises(ExtensionError, match="0 figures are open at its end, expected 1"):
        scrape(tmp_path)
    for _ in range(2):
        plt.subplots()[1].plot([1.0, 2.0])
    with pytest.raises(ExtensionError, match="2 figures are open at its end, expected 1"):
        scrape(tmp_path)


def test_an_example_without_a_place_is_refused():
    assert gallery_pages.reading_order("figure_2_linear_lift.py") < gallery_pages.reading_order("modes.py")
    with pytest.raises(ConfigError, match="the example unheard_of has no place"):
        gallery_pages.reading_order("unheard_of.py")


def build(folder, code):
    """Build a gallery of one example with the settings of docs/conf.py; return the process and the page's picture."""
    source, examples = folder / "source", folder / "examples"
    source.mkdir()
    examples.mkdir()
    (examples / "GALLERY_HEADER.rst").write_text("Gallery\n=======\n")
    (examples / "mass_chain.py").write_text(f'"""\nTitle\n=====\n\nText.\n"""\n\n{code}\n')
    (source / "index.rst").write_text("Index\n=====\n\n.. toctree::\n\n   gallery/index\n")
    (source / "conf.py").write_text(
        "import runpy\n"
        f"sphinx_gallery_conf = runpy.run_path({str(DOCS / 'conf.py')!r})['sphinx_gallery_conf']\n"
        "sphinx_gallery_conf.update(subsection_order=None)\n"
        "extensions = ['sphinx_gallery.gen_gallery']\n"
    )
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-E", str(source), str(folder / "html")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)
    return done, folder / "html" / "_images" / "sphx_glr_mass_chain_001.png"


DRAWN = """\
from matplotlib import pyplot as plt
figure, ax = plt.subplots()
ax.plot([1.0, 2.0])
figure.savefig("mass_chain.png")
"""


def test_the_page_of_a_sound_example_shows_its_figure(tmp_path):
    done, picture = build(tmp_path, DRAWN)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 1_000


@pytest.mark.parametrize(
    ("code", "message"),
    [
        pytest.param(DRAWN + "assert 1 + 1 == 3", "AssertionError", id="false assertion"),
        pytest.param(DRAWN + "import warnings\nwarnings.warn('beware')", "UserWarning: beware", id="warning"),
        pytest.param(DRAWN.replace("ax.plot", "\n# %%\n# Later.\nax.plot"), "1 figures are open", id="empty axes"),
    ],
)
def test_an_example_that_goes_wrong_ends_the_build(tmp_path, code, message):
    done, _ = build(tmp_path, code)
    assert done.returncode != 0
    assert "mass_chain.py" in done.stderr
    assert message in done.stderr

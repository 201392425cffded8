"""Pictures in a row as one file: GIF, MP4 or a page that needs no network, whole or not at all."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from hbnlp.core.checks import file_name, refused
from hbnlp.core.files import written_by_name, written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".gif", ".mp4", ".html")
_PAGE = """<!DOCTYPE html>
<meta charset="utf-8"><title>motion</title>
<style>body{{font-family:sans-serif}}img{{max-width:100%}}input{{width:20em;vertical-align:middle}}</style>
<img id="picture" alt="motion"><br>
<button id="play">stop</button> <input id="place" type="range" min="0" max="{last}" value="0">
<script>
const pictures = {pictures};
const place = document.getElementById("place"), button = document.getElementById("play");
let timer = null;
function show(i) {{
  place.value = i;
  document.getElementById("picture").src = "data:image/png;base64," + pictures[i];
}}
function play() {{
  timer = setInterval(() => show((Number(place.value) + 1) % pictures.length), {milliseconds});
  button.textContent = "stop";
}}
function stop() {{ clearInterval(timer); timer = null; button.textContent = "play"; }}
button.onclick = () => timer === null ? play() : stop();
place.oninput = () => {{ stop(); show(Number(place.value)); }};
show(0);
play();
</script>
"""


def film_name(name: str, path: Any) -> None:
    """Raise an error that names ``path`` unless a film of this name can be written here.

    Raises
    ------
    ValueError
        If the name ends in something else than .gif, .mp4 or .html, or in .mp4 where ffmpeg is not installed.
    """
    file_name(name, path)
    ending = Path(os.fsdecode(path)).suffix.lower()
    if ending not in FORMATS:
        raise refused(ValueError, name, path, f"a name that ends in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise refused(
            ValueError, name, path, "ffmpeg, which is not found, for .mp4: install it, or end in .gif or .html"
        )


def write_film(
    path: str | os.PathLike[str],
    figure: Figure,
    draw: Callable[[int], Any],
    n_frames: int,
    *,
    frames_per_second: int,
) -> None:
    """Write what a figure shows after each of ``draw(0)``, ``draw(1)``, ... to a file, by the ending of its name.

    Raises
    ------
    SaveError
        (An `OSError`.) If the file cannot be written; an older one is as it was.
    """
    ending = Path(os.fsdecode(path)).suffix.lower()
    if ending == ".mp4":
        with written_by_name(path, "film.mp4") as made:
            _write_mp4(made, figure, draw, n_frames, frames_per_second)
    else:
        with written_whole(path) as handle:
            (_write_gif if ending == ".gif" else _write_page)(handle, figure, draw, n_frames, frames_per_second)


def _pictures(figure: Figure, draw: Callable[[int], Any], n_frames: int) -> Iterator[Image.Image]:
    canvas = FigureCanvasAgg(figure)  # of no window, so that none is needed
    for k in range(n_frames):
        draw(k)
        canvas.draw()  # type: ignore[no-untyped-call]
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")  # type: ignore[no-untyped-call]


def _write_gif(
    handle: IO[bytes], figure: Figure, draw: Callable[[int], Any], n_frames: int, frames_per_second: int
) -> None:
    frames = list(_pictures(figure, draw, n_frames))
    milliseconds = int(1000 / frames_per_second)
    frames[0].save(handle, format="GIF", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0)


def _write_mp4(made: Path, figure: Figure, draw: Callable[[int], Any], n_frames: int, frames_per_second: int) -> None:
    writer = FFMpegWriter(fps=frames_per_second)
    with writer.saving(figure, os.fspath(made), figure.dpi):
        for k in range(n_frames):
            draw(k)
            writer.grab_frame()


def _write_page(
    handle: IO[bytes], figure: Figure, draw: Callable[[int], Any], n_frames: int, frames_per_second: int
) -> None:
    pictures = []
    for each in _pictures(figure, draw, n_frames):
        picture = io.BytesIO()
        each.save(picture, format="PNG")
        pictures.append(base64.b64encode(picture.getvalue()).decode())
    page = _PAGE.format(last=n_frames - 1, pictures=json.dumps(pictures), milliseconds=int(1000 / frames_per_second))
    handle.write(page.encode())

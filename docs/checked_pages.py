"""A Sphinx extension that reads the pages as they were built: they need no network, and no link within them is dead."""

from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

FETCHED = {"script": "src", "img": "src", "iframe": "src", "video": "src", "source": "src", "link": "href"}
LISTED_FOR_OTHERS = {"canonical", "next", "prev", "search", "index"}
"""Kinds of `link` that a browser does not fetch to show a page."""


class Page(HTMLParser):
    """Where a page leads to, what it fetches, and its own anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.fetched: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element."""
        given = {name: value or "" for name, value in attrs}
        self.anchors.update(given[name] for name in ("id", "name") if name in given)
        address = given.get(FETCHED.get(tag, ""), "")
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif address and not (tag == "link" and given.get("rel", "") in LISTED_FOR_OTHERS):
            self.fetched.append(address)


def faults(folder: Path) -> list[str]:
    """Return what is wrong with the pages in a folder, a line each; empty where nothing is."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        where = path.relative_to(folder.resolve())
        found += [f"{where}: asks the network for {each}" for each in page.fetched if urlsplit(each).netloc]
        for address in [*page.fetched, *page.links]:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.exists():
                found.append(f"{where}: {address} is not there")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                found.append(f"{where}: {address} leads to a page without that anchor")
    return found


def check(app: Sphinx, error: Exception | None) -> None:
    """End the build with an error if a page has a fault."""
    if error is None and app.builder.name == "html":
        found = faults(Path(app.outdir))
        if found:
            raise ExtensionError("\n".join([f"{len(found)} faults of the pages:", *found[:50]]))


def setup(app: Sphinx) -> dict[str, Any]:
    """Have the pages read at the very end, when all files are in their places."""
    app.connect("build-finished", check, priority=10_000)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

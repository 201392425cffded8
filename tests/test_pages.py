"""Pages that ask the network for something, or lead nowhere, are found when they are built."""

import checked_pages


def faults_of(tmp_path, body):
    (tmp_path / "other.html").write_text("<h1 id='there'></h1>", encoding="utf-8")
    (tmp_path / "page.html").write_text(body, encoding="utf-8")
    return checked_pages.faults(tmp_path)


def test_links_to_pages_anchors_and_other_sites_are_no_faults(tmp_path):
    body = "<a href='other.html#there'></a><a href='#here'></a><p id='here'><a href='https://example.org'></a>"
    assert faults_of(tmp_path, body) == []


def test_what_is_fetched_from_a_network_is_a_fault(tmp_path):
    (fault,) = faults_of(tmp_path, "<script src='https://cdn.example.org/mathjax.js'></script>")
    assert fault == "page.html: asks the network for https://cdn.example.org/mathjax.js"


def test_a_picture_or_page_that_is_not_there_is_a_fault(tmp_path):
    picture, page = faults_of(tmp_path, "<img src='_images/no.png'><a href='no.html'></a>")
    assert picture == "page.html: _images/no.png is not there"
    assert page == "page.html: no.html is not there"


def test_an_anchor_that_is_not_there_is_a_fault(tmp_path):
    (fault,) = faults_of(tmp_path, "<a href='other.html#gone'></a>")
    assert "without that anchor" in fault

import json
from html.parser import HTMLParser

import pytest
from PIL import Image

from deux.metrics.scorecard import Scorecard
from deux.report.contents import read_contents
from deux.report.page import html_page
from deux.report.report_figures import CaptionedFigure

VOID = {"meta", "img", "br", "link"}


class Reader(HTMLParser):
    """Checks that elements nest, and collects what they refer to and the cells of the tables."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.ids: set[str] = set()
        self.rows: list[list[str]] = []
        self.marked: dict[str, list[str]] = {"b": [], "u": []}
        self.text = ""

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.references += [named[key] for key in ("src", "href", "srcset", "data") if key in named]
        self.ids |= {named["id"]} if "id" in named else set()
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data
        if self.open and self.open[-1] in self.marked:
            self.marked[self.open[-1]].append(data)


def read_page(text):
    """Read a page whose elements must nest."""
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader


def test_corrected_depth_is_a_part_of_its_own(write_run, outputs, names):
    path = write_run("deux", "kbnet", 0, 20.0) / "results.json"
    errors = {"mae": 15.0, "rmse": 40.0, "imae": 30.0, "irmse": 90.0}
    path.write_text(json.dumps({**json.loads(path.read_text()), "corrected": errors}))
    reader = read_page(html_page(read_contents(outputs, names), {}))
    assert "#corrected" in reader.references
    assert "corrected" in reader.ids
    assert ["DEUX", "15.0", "40.0", "30.0", "90.0"] in reader.rows


def test_scorecards_are_a_part_of_their_own(write_run, outputs, names):
    for seed in range(3):
        for number, explorer in enumerate(("random", "deux")):
            run = write_run(explorer, "kbnet", seed, 20.0 - number)
            Scorecard(18, 18, 0.5, 0.4, 7, 9 + number, 0.2, 0.5, 0.3).save(run)
    reader = read_page(html_page(read_contents(outputs, names), {}))
    assert "#scorecards" in reader.references
    assert "scorecards" in reader.ids
    assert ["DEUX", "50.0", "40.0", "7", "10", "20.0", "50.0", "30.0", *["–"] * 6] in reader.rows
    assert ["views", "-1.00", "6"] in reader.rows
    assert "Below 0: runs with a larger value" in reader.text


@pytest.fixture
def page(write_run, write_sweep, outputs, names, tmp_path):
    write_sweep(["explore=deux,random", "seed=0,1"])
    write_run("random", "kbnet", 0, 20.0)
    write_run("random", "kbnet", 1, 22.0)
    write_run("deux", "kbnet", 0, 15.0)
    write_run("<wall> & co", "kbnet", 0, 99.0)
    Image.new("RGB", (8, 8), "red").save(tmp_path / "a.png")
    contents = read_contents(outputs, names)
    text = html_page(contents, {"table1": [CaptionedFigure(tmp_path / "a.png", 'A "picture" <b>')]})
    return text, read_page(text)


def test_it_is_well_formed_and_refers_to_nothing_outside(page):
    text, reader = page
    assert reader.open == []
    assert text.startswith("<!DOCTYPE html>")
    for reference in reader.references:
        assert reference.startswith("data:image/png;base64,") or reference.removeprefix("#") in reader.ids
    assert len(reader.references) == 2
    assert "http" not in text
    assert "url(" not in text
    assert "@import" not in text
    assert "<script" not in text


def test_numbers_and_marks_are_in_their_cells(page):
    _, reader = page
    rows = {row[0]: row[1:] for row in reader.rows}
    assert rows["Random"][0] == "21.0 ± 12.7 (seeds 0, 1)"  # t(0.975, 1) = 12.706, s / sqrt(2) = 1
    assert rows["DEUX"][0] == "15.0"
    assert rows["<wall> & co"][0] == "99.0"
    assert "15.0" in reader.marked["b"]
    assert "99.0" in reader.marked["u"]
    assert "21.0" not in reader.marked["u"]  # a mean over other seeds than the other numbers


def test_it_tells_what_is_missing_and_how_the_runs_were_made(page):
    _, reader = page
    assert "DEUX, KBNet: seed 1" in reader.text
    assert "python -m deux -m explore=deux,random seed=0,1" in reader.text
    assert "4 finished runs, 2 missing" in reader.text

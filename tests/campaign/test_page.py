"""The report: a page that needs nothing else, with the right numbers."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import pytest

from wbc.campaign.figures import figures
from wbc.campaign.report import page, table

from .lines import campaign, trial

ABOUT = {
    "scenario": "<b>x", "scenario_sha256": "ab" * 32, "seed": 3, "overrides": {"a": "1 & 2"},
    "varied": {}, "versions": {"wbc": "0.1"},
}  # fmt: skip
VOID = {"meta", "rect", "circle", "line"}


class Reader(HTMLParser):
    """Checks that tags are closed in order; gathers text and attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, Any]]] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, (tag, self.open, self.getpos())

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_the_page_is_whole_and_right() -> None:
    reader = Reader(page(campaign(), ABOUT))
    text = " ".join(" ".join(reader.text).split())
    assert "Success: 30 of 40, 75.0 % (95 % confidence: 59.8 to 85.8 %)" in text
    assert "dropped after # s 9 4" in text
    assert "crashed 1 3" in text
    assert "<too heavy>" in text and "<b>x: 40 trials" in text and "a=1 & 2" in text
    assert "object, error [mm] 20 37.1 39 0" in text
    charts = [attrs["aria-label"] for tag, attrs in reader.seen if "aria-label" in attrs]
    assert {"object, error [mm]", "mass", "friction", "position.x"} <= set(charts)
    assert "duration [s] 2 2 2 2" in text and "duration [s]" not in charts  # in all the same


def test_every_trial_is_in_the_bars() -> None:
    from xml.etree import ElementTree

    text = page(campaign(), ABOUT)
    start = text.index("<figure><figcaption>mass<")
    figure = ElementTree.fromstring(text[start : text.index("</figure>", start) + 9])
    counts = {"good": 0, "bad": 0}
    for bar in figure.iter("rect"):
        counts[bar.attrib["class"]] += int(bar.findtext("title") or 0)
        assert 0.0 <= float(bar.attrib["y"]) <= 110.0
    assert counts == {"good": 30, "bad": 10}


def test_the_page_asks_for_nothing_from_elsewhere() -> None:
    text = page(campaign(), ABOUT)
    assert not {"script", "link", "img", "iframe", "a"} & {tag for tag, _ in Reader(text).seen}
    assert "http" not in text and "url(" not in text and "@import" not in text


@pytest.mark.parametrize("count", [0, 1, 3])
@pytest.mark.parametrize("success", [True, False])
def test_a_page_of_little(count: int, success: bool) -> None:
    lines = [trial(n, success, {}, distance={"min": None, "t": None}) for n in range(count)]
    Reader(page(figures(lines), ABOUT))
    said = table(figures(lines))
    wanted = "no trials" if not count else f"{count * success} of {count}"
    assert wanted in said[0]


def test_the_printed_table() -> None:
    lines = [" ".join(line.split()) for line in table(campaign())]
    assert lines[0] == "success 30 of 40, 75.0 % (95 % confidence: 59.8 to 85.8 %)"
    assert lines[1] == "9 dropped after # s (first: trial 4)"
    assert lines[4] == "object, error [mm] 20 37.1 39 0"
    assert any("failures have another mass" in line for line in lines)

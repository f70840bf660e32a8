"""The report: one page that holds all it shows."""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from turning import turning, write_csv

from stateful_ahrs.evaluation.evaluate import main
from stateful_ahrs.evaluation.groups import groups
from stateful_ahrs.evaluation.score import prepare
from stateful_ahrs.evaluation.svg import Chart, Scale
from stateful_ahrs.evaluation.view import BINS, POINTS, apart, look
from stateful_ahrs.filters.stateful import Settings

VOID = {"meta", "link", "br", "img", "hr", "input"}


class Page(HTMLParser):
    """What is in a page; fails where an element is not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.tables: list[list[list[str]]] = []
        self.feed(text)
        assert self.open == []
        self.pictures = [
            ElementTree.fromstring(found) for found in re.findall("<svg.*?</svg>", text)
        ]

    def handle_starttag(self, tag, attributes):
        self.links += [value for key, value in attributes if key in ("href", "src", "data")]
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_startendtag(self, tag, attributes):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "td" in self.open or "th" in self.open:
            self.tables[-1][-1][-1] += data

    def words(self) -> list[str]:
        """All that is written in the pictures."""
        return [text.text or "" for picture in self.pictures for text in picture.iter("text")]


def page_of(tmp_path: Path, *argv: str) -> tuple[Page, str]:
    target = tmp_path / "report.html"
    assert main([*argv, "--report", str(target)]) == 0
    text = target.read_text(encoding="utf-8")
    return Page(text), text


@pytest.fixture
def table(tmp_path) -> str:
    return write_csv(tmp_path / "turning.csv", turning())


def test_it_opens_without_a_network(table, tmp_path):
    page, text = page_of(tmp_path, table, "--filters", "all", "--alpha", "0.9:0.999:4")
    assert all(link.startswith("#") for link in page.links)
    assert not re.search(r"https?:|url\(|@import|@font-face", text)


def test_its_tables_say_what_the_json_says(table, tmp_path):
    page, _ = page_of(
        tmp_path, table, "--filters", "stateful,paper", "--json", str(tmp_path / "x.json")
    )
    results = json.loads((tmp_path / "x.json").read_text())["results"]
    head, *rows = page.tables[-1]
    assert head[:4] == ["recording", "filter", "α", "τ (s)"]
    assert [row[1] for row in rows] == [result["filter"] for result in results]
    for row, result in zip(rows, results, strict=True):
        assert row[5:8] == [f"{angle:.2f}" for angle in result["rmse_deg"].values()]
    summary = page.tables[0]
    assert {row[0] for row in summary[1:]} == {"stateful", "paper"}


def test_every_filter_is_named_with_its_error_in_the_pictures(table, tmp_path):
    page, _ = page_of(tmp_path, table, "--filters", "stateful,paper_stateless")
    rows = page.tables[-1][1:]
    for row in rows:
        assert f"{row[1]}  {row[5]}°" in page.words()
    # errors over time, two rotors, an angle, an axis, a group
    assert len(page.pictures) == 6


def test_the_best_alpha_of_a_sweep_is_marked_with_its_time_constant(table, tmp_path):
    argv = (table, "--alpha", "0.9:0.999:5", "--json", str(tmp_path / "x.json"))
    page, text = page_of(tmp_path, *argv)
    (best,) = json.loads((tmp_path / "x.json").read_text())["best"]
    assert best["by"] == "reference"
    marked = [row for row in page.tables[-1] if row[2].endswith("*")]
    assert [float(row[2][:-1]) for row in marked] == [pytest.approx(best["alpha"], abs=1e-5)]
    assert any(f"τ {best['time_constant_s']:.3g} s" in word for word in page.words())
    assert "against the reference over α" in text


def test_without_a_reference_it_says_what_alpha_was_ranked_by(tmp_path):
    path = write_csv(tmp_path / "blind.csv", turning(600), "gam")
    page, text = page_of(tmp_path, path, "--alpha", "0.9:0.999:5")
    assert "There is no reference: α is ranked by self-consistency" in text
    assert "innovation" in page.tables[-1][0]
    assert len(page.pictures) == 5  # the sweep and four of the rotors


@pytest.mark.parametrize("rows", [1, 2, 40])
@pytest.mark.parametrize("streams", ["gamq", "ga"])
def test_short_and_blind_recordings_have_a_report_too(rows, streams, tmp_path):
    path = write_csv(tmp_path / "short.csv", turning(rows), streams)
    page, _ = page_of(tmp_path, path, "--filters", "all", "--alpha", "0.9:0.99:2")
    assert len(page.pictures) >= 4


def test_a_name_is_never_taken_for_markup(tmp_path):
    path = write_csv(tmp_path / "a<b>&'c'.csv", turning(50))
    page, text = page_of(tmp_path, path)
    assert "a&lt;b&gt;&amp;" in text
    assert page.tables[-1][1][0] == "a<b>&'c'"


def test_curves_are_thinned_to_what_can_be_seen(tmp_path):
    path = write_csv(tmp_path / "long.csv", turning(20_000))
    page, _ = page_of(tmp_path, path)
    curves = [curve.get("d") for picture in page.pictures for curve in picture.iter("path")]
    longest = max(curve.count(" ") for curve in curves)
    assert 100 < longest <= 2 * max(BINS, 2 * POINTS)  # a stride is whole: up to twice POINTS


def test_trials_are_grouped_as_broads_list_says(tmp_path):
    for name in ("walk", "run", "swim"):
        write_csv(tmp_path / f"{name}.csv", turning(50))
    listed = {"walk": {"groups": ["all", "slow"]}, "run": {"groups": ["all", "fast", "hard"]}}
    (tmp_path / "trials.json").write_text(json.dumps({"trials": listed}))
    paths = {name: tmp_path / f"{name}.csv" for name in ("walk", "run", "swim")}
    assert groups(paths) == {
        "all": ["walk", "run"],
        "slow": ["walk"],
        "fast, hard": ["run"],
        "swim": ["swim"],
    }
    page, _ = page_of(tmp_path, *map(str, paths.values()))
    assert "all (2 trials)" in page.words()


@pytest.mark.parametrize("content", ["", "[1, 2]", '{"trials": {"walk": {"groups": "slow"}}}'])
def test_another_list_of_trials_is_none(content, tmp_path):
    (tmp_path / "trials.json").write_text(content)
    assert groups({"walk": tmp_path / "walk.csv"}) == {"walk": ["walk"]}


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("x.pdf", "--report x.pdf: the name must end in .html."),
        ("no/such/x.html", "--report no/such/x.html: there is no folder no/such."),
    ],
)
def test_a_report_that_cannot_be_is_refused_before_any_work(name, sentence, capsys):
    assert main(["x.csv", "--report", name]) == 2
    assert capsys.readouterr().err == f"evaluate: {sentence}\n"


def test_the_angle_runs_on_where_the_rotor_is_stateful():
    view = look(prepare(turning(2000, level=0.0)), {"stateful": Settings()})
    turned = 90.0 + math.degrees(view.at[-1])  # from east, at 1 rad/s
    assert view.angles["stateful"][-1] == pytest.approx(turned, abs=0.1)
    assert np.diff(view.angles["stateful"]).min() > 0.0
    assert view.angles["paper_stateless"].max() <= 360.0
    assert view.axes == pytest.approx(np.tile((0.0, 0.0, 1.0), (len(view.at), 1)), abs=1e-3)


# Scales and charts


def test_ticks_are_round_and_within_the_scale():
    assert [word for _, word in Scale(0.0, 186.0).ticks(10)] == [str(n) for n in range(0, 181, 20)]
    assert [word for _, word in Scale(-1.0, 1.0).ticks(4)] == ["−1", "−0.5", "0", "0.5", "1"]
    assert [word for _, word in Scale(0.1, 200.0, log=True).ticks()] == ["0.1", "1", "10", "100"]
    assert [word for _, word in Scale(1.5, 30.0, log=True).ticks()] == ["2", "5", "10", "20"]
    assert [value for value, _ in Scale(0.1, 0.001, log=True).ticks()] == pytest.approx(
        [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1]
    )


def test_a_curve_is_broken_where_nothing_is_known():
    chart = Chart((110, 110), Scale(0.0, 100.0), Scale(0.0, 100.0), (5, 5, 5, 5))
    xs = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    chart.curve(xs, np.array([0.0, 50.0, np.nan, 100.0, 900.0]), "kind")
    (path,) = ElementTree.fromstring(chart.svg("x")).iter("path")
    assert path.get("d") == "M5 105l0 0 10 -50M35 5l0 0 10 0"  # 900 is drawn at the end: 100


def test_labels_are_moved_apart_as_little_as_need_be():
    assert apart([0.1, 0.5, 0.9], 0.1) == pytest.approx([0.1, 0.5, 0.9])
    assert apart([0.5, 0.5], 0.1) == pytest.approx([0.45, 0.55])
    assert apart([0.0, 0.0, 0.9], 0.1) == pytest.approx([0.0, 0.1, 0.9])
    assert apart([0.9, 1.0, 1.0], 0.1) == pytest.approx([0.8, 0.9, 1.0])

"""The page: sections of claims, each with what is printed, what was measured, and a verdict."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

AS_PRINTED = "as printed"
BETTER = "better than printed"
WORSE = "short of what is printed"
DIFFERENT = "differs from what is printed"
WRONG = "the paper is wrong"
MEASURED = "measured"  # there is nothing printed to compare it with

HEAD = """\
# The papers, reproduced

Each figure and table of the four papers that the data allow, made anew by the code of this
repository: what is printed, what was measured, and a verdict. `make reproduce` writes this page and
its figures. What needs the trials of BROAD is made by `make reproduce DATA=folder`, the folder of
its `.mat` files; without it those sections stay as they are.

Recordings are those of the simulated MPU-9250, register by register and with the noise of its data
sheet, where no BROAD is named. Operations are counted by running the filters' own kernels on
numbers that count; nothing is typed in. Times are compiled, each algorithm in turn, the fastest of
several rounds in one run on one core of a shared machine: only ratios mean anything.
"""
ABSENT = "*This part needs the trials of BROAD: `make reproduce DATA=folder`.*\n"


@dataclass(frozen=True)
class Claim:
    """A row: what it is about, as printed, as measured, and how the two go together."""

    what: str
    printed: str
    measured: str
    verdict: str


@dataclass(frozen=True)
class Section:
    """A part of the page with its figures (name → SVG)."""

    title: str
    text: str
    claims: Sequence[Claim] = ()
    table: Sequence[Sequence[str]] = ()  # the first row is its head
    figures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """How a section is made; ``broad`` where it needs BROAD's trials."""

    name: str
    make: Callable[[], Section]
    broad: bool = False


def near(measured: float, printed: float, share: float = 0.03) -> str:
    """The verdict on a figure that is to be the printed one, but for a share of it."""
    return AS_PRINTED if abs(measured - printed) <= share * abs(printed) else DIFFERENT


def at_most(measured: float, printed: float) -> str:
    """The verdict on a figure that is the better the smaller it is."""
    if measured < printed:
        return BETTER
    return AS_PRINTED if measured == printed else WORSE


def shown(truth: bool) -> str:
    """The verdict on what a figure shows."""
    return AS_PRINTED if truth else DIFFERENT


def refuted(truth: bool, why: str = "") -> str:
    """The verdict on what a paper says, and which is refuted if ``truth``."""
    return WRONG + (why and f": {why}") if truth else AS_PRINTED


def markdown(section: Section, folder: str) -> str:
    """The section; its figures are in that folder."""
    lines = [f"### {section.title}", "", textwrap.fill(section.text, 100), ""]
    for name in section.figures:
        lines += [f"![{section.title}]({folder}/{name}.svg)", ""]
    if section.table:
        lines += [*table(section.table), ""]
    if section.claims:
        rows = [(c.what, c.printed, c.measured, f"**{c.verdict}**") for c in section.claims]
        lines += [*table([("", "printed", "here", "verdict"), *rows]), ""]
    return "\n".join(lines)


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, whose first row is its head."""
    head, *others = ("| " + " | ".join(row) + " |" for row in rows)
    return [head, "|" + "---|" * len(rows[0]), *others]


def write(
    papers: Mapping[str, Sequence[Part]],
    docs: Path,
    broad: bool,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Make the parts and write ``reproduction.md`` with its figures into the folder ``docs``.

    Without BROAD what needs it is taken over from the page that is there.
    """
    page = docs / "reproduction.md"
    old = _sections(page.read_text(encoding="utf-8")) if page.exists() else {}
    figures = docs / page.stem
    figures.mkdir(parents=True, exist_ok=True)
    text = ""
    for paper, parts in papers.items():
        text += f"\n## {paper}\n"
        for part in parts:
            if part.broad and not broad:
                say(f"{part.name} needs BROAD's trials (DATA=folder): it stays as it was.")
                made = old.get(part.name, ABSENT)
            else:
                say(part.name)
                section = part.make()
                made = markdown(section, page.stem)
                for name, svg in section.figures.items():
                    (figures / f"{name}.svg").write_text(svg + "\n", encoding="utf-8")
            text += f"\n<!-- {part.name} -->\n{made}<!-- end -->\n"
    page.write_text(HEAD + "\n".join(summary(text)) + "\n" + text, encoding="utf-8")


def summary(text: str) -> list[str]:
    """How often each verdict was given to each paper, and what is wrong in them."""
    verdicts = {AS_PRINTED: 0, BETTER: 1, WORSE: 2, DIFFERENT: 2, WRONG: 3}
    rows, wrong, section = [["", "as printed", "better", "short or different", "wrong"]], [], ""
    numbers: list[int] = []
    for line in [*text.splitlines(), "## "]:
        if line.startswith("## "):
            if any(numbers):
                rows[-1] += [str(number) for number in numbers]
            rows.append([line.removeprefix("## ")])
            numbers = [0] * 4
        section = line.removeprefix("### ") if line.startswith("### ") else section
        claim = re.fullmatch(r"\| (.*) \| .* \| .* \| \*\*(.*)\*\* \|", line)
        for verdict, column in verdicts.items():
            if claim and claim[2].startswith(verdict):
                numbers[column] += 1
                if verdict == WRONG:
                    why = claim[2].removeprefix(WRONG).removeprefix(": ")
                    wrong.append(f"- {rows[-1][0]}. {section}: {claim[1]}{why and f': {why}'}")
    full = [row for row in rows if len(row) == len(rows[0])]
    return ["", *table(full), "", "What is wrong in print:", "", *wrong]


def _sections(text: str) -> dict[str, str]:
    found = re.findall(r"^<!-- (\S+) -->\n(.*?)^<!-- end -->$", text, re.DOTALL | re.MULTILINE)
    return dict(found)

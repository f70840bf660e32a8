"""How a report looks, by day, by night and on paper, and how its tables are sorted."""

STYLE = """\
:root {
  color-scheme: light dark;
  --page: #fff; --ink: #1f2328; --pale: #667079; --line: #d6dade; --faint: #eceff1;
  --truth: #d3d7da; --red: #c8372d; --green: #23835f; --blue: #0b62a8;
  --h0: #0b62a8; --h1: #23835f; --h2: #b86e00; --h3: #7a4fa0;
  --h4: #2488b8; --h5: #85642f; --h6: #b0457f; --h7: #64761a;
}
@media screen and (prefers-color-scheme: dark) {
  :root {
    --page: #14171a; --ink: #e4e7ea; --pale: #98a2ab; --line: #3a4148; --faint: #23282d;
    --truth: #4a525a; --red: #f4776b; --green: #58c79b; --blue: #6cb2f4;
    --h0: #6cb2f4; --h1: #58c79b; --h2: #eda83c; --h3: #bb98e6;
    --h4: #7fd3ee; --h5: #cbab77; --h6: #ec8fc0; --h7: #b8cc55;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0 auto; padding: 2.5rem 1.25rem 4rem; max-width: 60rem; background: var(--page);
  color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", "Liberation Sans",
  sans-serif; font-variant-numeric: tabular-nums;
}
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; }
h3 { font-size: 1rem; margin: 2.2rem 0 .4rem; overflow-wrap: anywhere; }
p { margin: .3rem 0; max-width: 48rem; }
code { font-size: .87em; overflow-wrap: anywhere; color: var(--pale); }
a { color: var(--blue); text-decoration: none; }
a:hover { text-decoration: underline; }
nav { columns: 16rem; font-size: .87rem; margin: .5rem 0; overflow-wrap: anywhere; }
nav a { display: block; }
figure { margin: 1rem 0 1.6rem; break-inside: avoid; }
figcaption, caption { color: var(--pale); font-size: .87rem; text-align: left; max-width: 50rem; }
footer { color: var(--pale); font-size: .87rem; margin-top: 2rem; }
figcaption { margin-top: .5rem; }
caption { padding-bottom: .5rem; }
b { color: var(--ink); }
.pair { display: grid; gap: .6rem 1rem; grid-template-columns: repeat(2, minmax(0, 1fr)); }
.pair h4 { font-size: .87rem; font-weight: 600; margin: .6rem 0 .1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .87rem; }
th, td { padding: .16rem .7rem .16rem 0; text-align: right; white-space: nowrap; }
th { border-bottom: 1px solid var(--pale); font-weight: 600; vertical-align: bottom; }
tbody tr:hover { background: var(--faint); }
td.word, th.word { text-align: left; }
tr.best, td.least { font-weight: 700; }
th button { all: unset; cursor: pointer; }
th button:hover, th button:focus-visible { color: var(--blue); }
th[aria-sort=ascending] button::after { content: " ↑"; }
th[aria-sort=descending] button::after { content: " ↓"; }
svg { display: block; width: 100%; height: auto; overflow: visible; }
svg text { font-size: 12px; fill: var(--c, var(--ink)); }
svg .tick { fill: var(--c, var(--pale)); font-size: 11px; }
svg .middle { text-anchor: middle; }
svg .end { text-anchor: end; }
svg .name { font-weight: 600; }
.grid { stroke: var(--line); stroke-width: .6; }
.axis { stroke: var(--pale); stroke-width: .8; }
.curve { fill: none; stroke: var(--c); stroke-width: 1.5; stroke-linejoin: round; }
.curve.truth { stroke-width: 4.5; }
.curve.faint { stroke-width: .7; opacity: .6; }
.thin { stroke-width: 1; }
.curve:hover { stroke-width: 3; }
svg:has(.curve:hover) .curve:not(:hover) { opacity: .2; }
.dot { fill: var(--c); stroke: var(--page); stroke-width: 1; }
.each { --c: var(--ink); stroke: none; opacity: .6; }
.box rect { fill: var(--c); fill-opacity: .22; stroke: var(--c); }
.box path { stroke: var(--c); }
.box .median { stroke-width: 2.4; }
.unscored { fill: var(--faint); }
.window { stroke: var(--ink); stroke-width: 3; }
.truth { --c: var(--truth); } .faint { --c: var(--pale); }
.w { --c: var(--ink); } .x { --c: var(--red); } .y { --c: var(--green); } .z { --c: var(--blue); }
.red { --c: var(--red); }
.h0 { --c: var(--h0); } .h1 { --c: var(--h1); } .h2 { --c: var(--h2); } .h3 { --c: var(--h3); }
.h4 { --c: var(--h4); } .h5 { --c: var(--h5); } .h6 { --c: var(--h6); } .h7 { --c: var(--h7); }
.curve.d1 { stroke-dasharray: 7 3; } .curve.d2 { stroke-dasharray: 2 3; }
@media screen and (max-width: 44rem) { .pair { grid-template-columns: 1fr; } }
@media print {
  h2, h3 { break-after: avoid; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav { display: none; }
}
"""

SCRIPT = """\
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  heads.forEach((head, column) => head.firstChild.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    heads.forEach(other => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const words = head.classList.contains("word");
    const text = row => row.cells[column].textContent;
    const key = row => parseFloat(text(row));
    const order = (a, b) => words ? text(a).localeCompare(text(b)) : key(a) - key(b);
    const told = row => words || !isNaN(key(row));
    const rows = [...body.rows];
    const known = rows.filter(told).sort((a, b) => up ? order(a, b) : order(b, a));
    body.append(...known, ...rows.filter(row => !told(row)));
  }));
}
"""

"""A campaign as one HTML page that needs nothing else, and as lines for the terminal."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.campaign.figures import Figures

_CHARTS: Final = 8  # of drawn quantities
_LISTED: Final = 200  # failures
_BINS: Final = 24
_WIDTH, _HEIGHT = 300, 110

_STYLE: Final = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 62rem;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .2rem .9rem .2rem 0;
  border-bottom: 1px solid #ddd; vertical-align: top; } td.n, th.n { text-align: right; }
code { font-size: .9em; overflow-wrap: anywhere; } .charts { display: flex; flex-wrap: wrap;
  gap: 1rem; margin-top: 1rem; } figure { margin: 0; } figcaption { font-size: .9em; }
.good { fill: #4878a8; } .bad { fill: #c8483c; } svg text { font-size: 11px; fill: #555; }
"""


def table(figures: Figures) -> list[str]:
    """The campaign in a few lines of plain text."""
    rows = [f"success        {_rate(figures)}"]
    for what, count, first in figures.kinds:
        rows.append(f"  {count:>5}  {what} (first: trial {first})")
    if figures.measures:
        rows.append(f"{'':<42}{'median':>10}{'95 %':>10}{'largest':>10}{'smallest':>10}")
        for name, values in figures.measures.items():
            rows.append(f"{name:<42}" + "".join(f"{_short(v):>10}" for v in _spread(values)))
    telling = [c for c in figures.comparisons if c.p < 0.01][:3]
    for c in telling:
        rows.append(
            f"failures have another {c.name}: median {_short(c.failure)}, "
            f"successes {_short(c.success)} (p {c.p:.1g})"
        )
    return rows


def page(figures: Figures, about: Mapping[str, Any]) -> str:
    """The campaign as HTML.

    Args:
        about: what campaign.json says.
    """
    name = html.escape(str(about.get("scenario", "")))
    parts = [
        f"<h1>{name}: {len(figures.success)} trials</h1>",
        f"<p><b>Success: {_rate(figures)}</b></p>",
        _campaign(about),
        *_failures(figures),
        "<h2>How large</h2>",
        _rows(
            ("", "median", "95 %", "largest", "smallest"),
            [(n, *map(_short, _spread(v))) for n, v in figures.measures.items()],
        ),
        _legend() if figures.measures else "",
        _charts(figures, figures.measures),
        *_causes(figures),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{name}: sweep</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(filter(None, parts))
        + "\n</body>\n</html>\n"
    )


def _rate(figures: Figures) -> str:
    rate, n = figures.rate, len(figures.success)
    if not n:
        return "no trials"
    return (
        f"{int(figures.success.sum())} of {n}, {100 * rate.share:.1f} % "
        f"(95 % confidence: {100 * rate.low:.1f} to {100 * rate.high:.1f} %)"
    )


def _campaign(about: Mapping[str, Any]) -> str:
    settings = [f"{k}={v}" for k, v in dict(about.get("overrides", {})).items()]
    varied = [f"{k}: {v}" for k, v in dict(about.get("varied", {})).items()]
    versions = [f"{k} {v}" for k, v in dict(about.get("versions", {})).items()]
    rows = [
        ("seed", str(about.get("seed", ""))),
        ("set", ", ".join(settings)),
        ("varied", ", ".join(varied)),
        ("scenario", str(about.get("scenario_sha256", ""))[:12]),
        ("versions", ", ".join(versions)),
    ]
    return _rows(("", ""), [row for row in rows if row[1]])


def _failures(figures: Figures) -> list[str]:
    kinds = figures.kinds
    if not kinds:
        return ["<h2>What failed</h2>", "<p>Nothing.</p>"]
    bad = np.flatnonzero(~figures.success)
    rows = [
        (str(figures.numbers[k]), str(figures.seeds[k]), figures.reasons[k]) for k in bad[:_LISTED]
    ]
    more = f"<p>And {len(bad) - _LISTED} more.</p>" if len(bad) > _LISTED else ""
    return [
        "<h2>What failed first</h2>",
        _rows(("reason", "trials", "first"), [(k, str(n), str(first)) for k, n, first in kinds]),
        "<details><summary>The trials that failed</summary>",
        _rows(("trial", "seed", "reason"), rows),
        more + "</details>",
    ]


def _causes(figures: Figures) -> list[str]:
    if not figures.drawn:
        return []
    parts = ["<h2>What goes with failure</h2>"]
    if figures.comparisons:
        parts += [
            "<p>Drawn values of failures against those of successes, the most telling first. "
            "Above: how often a failure's value is above a success's, 0.5 where it makes no "
            "difference. p is of one Mann-Whitney test; of many, some are small by chance.</p>",
            _rows(
                ("", "successes, median", "failures, median", "above", "p"),
                [
                    (c.name, _short(c.success), _short(c.failure), f"{c.above:.2f}", f"{c.p:.2g}")
                    for c in figures.comparisons
                ],
            ),
        ]
    else:
        parts.append("<p>Too few successes or failures to compare.</p>")
    told = [c.name.removesuffix(", off the middle") for c in figures.comparisons]
    names = list(dict.fromkeys([*told, *figures.drawn]))[:_CHARTS]
    return [*parts, _charts(figures, {name: figures.drawn[name] for name in names})]


def _legend() -> str:
    box = '<svg width="12" height="12"><rect class="{}" width="12" height="12"/></svg> {}'
    return f"<p>{box.format('good', 'successes')} &nbsp; {box.format('bad', 'failures')}</p>"


def _charts(figures: Figures, columns: Mapping[str, Array]) -> str:
    drawn = [
        _chart(name, values, figures.success)
        for name, values in columns.items()
        if np.nanmax(values) > np.nanmin(values)
    ]
    return '<div class="charts">\n' + "\n".join(drawn) + "\n</div>" if drawn else ""


def _chart(name: str, values: Array, success: BoolArray) -> str:
    """Histogram of values that differ, failures on top of successes."""
    known = ~np.isnan(values)
    low, high = float(values[known].min()), float(values[known].max())
    edges = np.linspace(low, high, _BINS + 1)
    good = np.histogram(values[known & success], edges)[0]
    bad = np.histogram(values[known & ~success], edges)[0]
    scale, width = _HEIGHT / max(int((good + bad).max()), 1), _WIDTH / len(good)
    bars = []
    for k, (g, b) in enumerate(zip(good, bad, strict=True)):
        top = float(_HEIGHT)
        for kind, count in (("good", g), ("bad", b)):
            if count:
                top -= scale * count
                bars.append(
                    f'<rect class="{kind}" x="{width * k:.1f}" y="{top:.1f}" '
                    f'width="{max(width - 1.0, 1.0):.1f}" height="{scale * count:.1f}">'
                    f"<title>{count}</title></rect>"
                )
    label, y = html.escape(name), _HEIGHT + 14
    ends = (
        f'<text x="0" y="{y}">{_short(low)}</text>'
        f'<text x="{_WIDTH}" y="{y}" text-anchor="end">{_short(high)}</text>'
    )
    return (
        f'<figure><figcaption>{label}</figcaption><svg width="{_WIDTH}" height="{_HEIGHT + 18}" '
        f'role="img" aria-label="{label}">{"".join(bars)}{ends}</svg></figure>'
    )


def _rows(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>\n"
        for row in rows
    )
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    return f"<table>\n<tr>{top}</tr>\n{body}</table>" if any(head) else f"<table>\n{body}</table>"


def _spread(values: Array) -> tuple[float, float, float, float]:
    """Median, 95th percentile, largest, smallest."""
    known = values[~np.isnan(values)]
    median, most = np.percentile(known, [50.0, 95.0])
    return float(median), float(most), float(known.max()), float(known.min())


def _short(value: float) -> str:
    return f"{value:.3g}"

"""The report of a sweep: a single HTML file without scripts or external resources.

It shows the pass rate of each test and over each parameter, distributions of recorded values, the
worst cases with the commands that repeat them, and everything that the results depend on.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from html import escape
from typing import Final

import numpy as np

from obelisk_spec.suggestions import with_number
from obk_testing.sweep.summary import PassRate, Result, Summary, duration_text

__all__ = ["report_page"]

_STYLE: Final = """
:root{--page:#fbfbfa;--card:#fff;--text:#1f2328;--dim:#656d76;--line:#d9dce0;--bar:#e6e8eb;
--good:#2f7d4f;--bad:#b3372f;--hist:#4a6fa5;color-scheme:light dark}
@media (prefers-color-scheme:dark){:root{--page:#16181b;--card:#1e2125;--text:#e4e6e8;--dim:#9aa2ab;
--line:#363b41;--bar:#32373d;--good:#56b37c;--bad:#e5776e;--hist:#7fa3d8}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--text);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main{max-width:960px;margin:0 auto;padding:24px 16px 48px}
h1{font-size:22px;margin:0 0 2px;font-weight:600}
h2{font-size:17px;margin:32px 0 8px;font-weight:600}
h3{font-size:14px;margin:0 0 6px;font-weight:600;overflow-wrap:anywhere}
p{margin:4px 0}.dim{color:var(--dim)}.bad{color:var(--bad)}.good{color:var(--good)}
.card{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:12px 14px;
margin:0 0 10px}
.grid{display:grid;gap:10px;grid-template-columns:repeat(auto-fill,minmax(min(100%,300px),1fr))}
.grid .card{margin:0}
.rate{display:flex;height:8px;background:var(--bar);border-radius:2px;overflow:hidden;margin:6px 0}
.rate i{background:var(--good)}.rate b{background:var(--bad)}
code{font:13px/1.5 ui-monospace,SFMono-Regular,Menlo,monospace;overflow-wrap:anywhere}
pre{margin:6px 0 0;padding:8px 10px;background:var(--page);border:1px solid var(--line);
border-radius:4px;white-space:pre-wrap;overflow-wrap:anywhere;
font:13px/1.45 ui-monospace,SFMono-Regular,Menlo,monospace;user-select:all}
svg{display:block;width:100%;height:auto}
svg text{fill:var(--dim);font:11px system-ui,sans-serif}
.all{fill:var(--bar)}.ok{fill:var(--good)}.hist{fill:var(--hist)}.axis{stroke:var(--line)}
table{border-collapse:collapse;width:100%}td{padding:3px 12px 3px 0;vertical-align:top;
overflow-wrap:anywhere}td:first-child{color:var(--dim);white-space:nowrap}
"""
_WIDTH: Final = 320
_HEIGHT: Final = 110
_FOOT: Final = 30
"""Space below a chart for its labels."""
_HEAD: Final = 14
"""Space above a chart for the counts."""
_BARS: Final = 20
_LONGEST_LABEL: Final = 8


def report_page(summary: Summary) -> str:
    """Return the report as HTML."""
    body = "\n".join(_body(summary))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>Sweep of {escape(summary.name)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _body(summary: Summary) -> Iterator[str]:
    yield from _head(summary)
    yield "<h2>Tests</h2>"
    for test, results in summary.tests.items():
        yield _test_card(test, results)
    for path in summary.varied:
        yield f"<h2>Pass rate [%] over <code>{escape(path)}</code></h2>"
        yield '<div class="grid">'
        for test in summary.tests:
            yield f'<div class="card"><h3>{escape(test)}</h3>'
            yield _rates_chart(summary.parts(test, path)) + "</div>"
        yield "</div>"
    yield from _metrics(summary)
    yield from _worst(summary)
    yield "<h2>What the results depend on</h2>"
    yield '<div class="card"><table>'
    for name, value in (*summary.machine.items(), ("engine", summary.engine)):
        yield f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>"
    yield "</table>"
    yield "<p>The same seed gives the same bits on this CPU with these versions.</p></div>"


def _head(summary: Summary) -> Iterator[str]:
    done, bad = len(summary.results), len(summary.bad)
    count = with_number(summary.count, "case")
    yield f"<h1>Sweep of {escape(summary.name)}</h1>"
    ended = count if done == summary.count else f"{done} of {count}"
    kind, verdict = ("bad", f"{bad} failed") if bad else ("good", "all passed")
    busy = duration_text(sum(result.row.seconds for result in summary.results))
    yield f'<p>{ended}, <span class="{kind}">{verdict}</span></p>'
    yield f'<p class="dim"><code>{escape(summary.config)}</code>, {busy} of computing</p>'
    if done < summary.count:
        yield "<p>The sweep was interrupted; run the same command again to continue it.</p>"
    for note in summary.notes:
        yield f'<p class="bad">{escape(note)}</p>'


def _test_card(test: str, results: Sequence[Result]) -> str:
    skipped = sum(result.row.outcome == "skipped" for result in results)
    passed = sum(result.row.outcome == "passed" for result in results)
    count = len(results) - skipped
    rate = 100 * passed / count if count else 0.0
    rest = 100 - rate if count else 0.0
    left_out = f", {skipped} skipped" if skipped else ""
    bars = f'<i style="width:{rate:.3f}%"></i><b style="width:{rest:.3f}%"></b>'
    return (
        f'<div class="card"><h3>{escape(test)}</h3><div class="rate">{bars}</div>'
        f'<p class="dim">{passed} of {count} passed ({rate:.4g} %){left_out}</p></div>'
    )


def _rates_chart(parts: Sequence[PassRate]) -> str:
    """Chart the fraction of passed cases, with one bar per value or part of the range."""
    step = _WIDTH / max(len(parts), 1)
    bars, labels = [], []
    for number, part in enumerate(parts):
        x, width = number * step + 1, step - 2
        share = part.passed / part.count if part.count else 0.0
        title = f"<title>{escape(part.label)}: {part.passed} of {part.count} passed</title>"
        bars.append(f"<g>{title}{_bar('all', x, width, float(part.count > 0))}")
        bars.append(f"{_bar('ok', x, width, share)}</g>")
        middle = x + width / 2
        labels.append(
            _label(middle, _HEAD - 4, f"{100 * share:.0f}" if part.count else "", "middle")
        )
        if part.low is None:
            labels.append(_label(middle, _HEAD + _HEIGHT + 14, _short(part.label), "middle"))
    if parts and parts[0].low is not None:
        labels.append(_label(0, _HEAD + _HEIGHT + 14, f"{parts[0].low:.4g}", "start"))
        labels.append(_label(_WIDTH, _HEAD + _HEIGHT + 14, f"{parts[-1].high:.4g}", "end"))
    return _chart("Fraction of cases that passed", bars, labels)


def _histogram(values: Sequence[float]) -> str:
    """Chart how often each value of a metric occurred."""
    low, high = min(values), max(values)
    counts = [0] * (_BARS if high > low else 1)
    for value in values:
        share = (value - low) / (high - low) if high > low else 0.0
        counts[min(int(share * len(counts)), len(counts) - 1)] += 1
    step = _WIDTH / len(counts)
    bars = []
    for number, count in enumerate(counts):
        start = low + number * (high - low) / len(counts)
        end = low + (number + 1) * (high - low) / len(counts)
        title = f"<title>{start:.4g} to {end:.4g}: {with_number(count, 'case')}</title>"
        bar = _bar("hist", number * step + 0.5, step - 1, count / max(counts))
        bars.append(f"<g>{title}{bar}</g>")
    labels = [
        _label(0, _HEAD + _HEIGHT + 14, f"{low:.4g}", "start"),
        _label(0, _HEAD - 4, f"{max(counts)}", "start"),
    ]
    if high > low:
        labels.append(_label(_WIDTH, _HEAD + _HEIGHT + 14, f"{high:.4g}", "end"))
    return _chart("Distribution", bars, labels)


def _bar(kind: str, x: float, width: float, share: float) -> str:
    height = share * _HEIGHT
    y = _HEAD + _HEIGHT - height
    return (
        f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
    )


def _label(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.0f}" text-anchor="{anchor}">{escape(text)}</text>'


def _chart(name: str, bars: Sequence[str], labels: Sequence[str]) -> str:
    floor = _HEAD + _HEIGHT + 0.5
    axis = f'<line class="axis" x1="0" y1="{floor}" x2="{_WIDTH}" y2="{floor}"/>'
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEAD + _HEIGHT + _FOOT}" role="img" aria-label="{name}">'
        f"{''.join(bars)}{axis}{''.join(labels)}</svg>"
    )


def _metrics(summary: Summary) -> Iterator[str]:
    cards = []
    for test in summary.tests:
        for name, pairs in summary.metrics(test).items():
            cards.append(
                f'<div class="card"><h3>{escape(name)}</h3><p class="dim">{escape(test)}</p>'
                f"{_distribution([value for _, value in pairs])}</div>"
            )
    if cards:
        yield "<h2>Recorded values</h2>"
        yield f'<div class="grid">{"".join(cards)}</div>'


def _distribution(values: Sequence[float]) -> str:
    """Chart and describe the values of a metric; those that are not finite are only counted."""
    finite = [value for value in values if math.isfinite(value)]
    missing = sum(map(math.isnan, values))
    infinite = len(values) - len(finite) - missing
    parts = []
    if finite:
        median, p95 = np.quantile(finite, (0.5, 0.95))
        parts.append(f"median {median:.4g}, p95 {p95:.4g}, max {max(finite):.4g}")
    if missing:
        parts.append(f'<span class="bad">NaN in {with_number(missing, "case")}</span>')
    if infinite:
        parts.append(f'<span class="bad">infinite in {with_number(infinite, "case")}</span>')
    return f"{_histogram(finite) if finite else ''}<p>{', '.join(parts)}</p>"


def _worst(summary: Summary) -> Iterator[str]:
    worst = summary.worst()
    if not worst:
        return
    yield "<h2>Worst cases</h2>"
    for result, reason in worst:
        kind = "bad" if result.row.is_bad else "dim"
        yield f'<div class="card"><h3>{escape(result.case.test)}</h3>'
        yield f"<p>{escape(result.title)}: <span class={kind}>{escape(reason)}</span></p>"
        if result.row.why:
            yield f"<p><code>{escape(result.row.why)}</code></p>"
        if result.row.metrics:
            values = ", ".join(f"{name} = {_shown(v)}" for name, v in result.row.metrics.items())
            yield f'<p class="dim">{escape(values)}</p>'
        yield f"<pre>{escape(summary.rerun_command(result.case))}</pre></div>"
    hidden = len(summary.bad) - sum(result.row.is_bad for result, _ in worst)
    if hidden > 0:
        yield f'<p class="dim">{with_number(hidden, "more failed case")} in sweep.sqlite</p>'


def _short(label: str) -> str:
    """Shorten a label to fit below a bar."""
    with suppress(ValueError):
        return f"{float(label):.3g}"
    return label if len(label) <= _LONGEST_LABEL else f"{label[: _LONGEST_LABEL - 1]}…"


def _shown(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)

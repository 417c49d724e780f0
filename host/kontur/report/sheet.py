# SPDX-License-Identifier: Apache-2.0
"""A page that needs nothing else: its frame, its style, and pictures inside it."""

from __future__ import annotations

import base64
import io
from html import escape

from matplotlib.figure import Figure

_WIDE_IN = 8.0


def document(title: str, answer: str, content: str, script: str = "") -> str:
    """The HTML page. `answer`, HTML that stands on top, and `content` are escaped already; `title` is not.

    The page loads nothing, and runs the one script whose hash is `script`, or none.
    """
    allowed = f"'{script}'" if script else "'none'"
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline';
 script-src {allowed}">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{CSS}</style>
</head>
<body>
<main>
<header>
<p class="kicker">Kontur</p>
<h1>{escape(title)}</h1>
<p class="answer">{answer}</p>
</header>
{content}
</main>
</body>
</html>
"""


def pictured(figure: Figure, heading: str, note: str, alt: str) -> str:
    """A drawn figure inside the page, with heading and note."""
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    data = base64.b64encode(out.getvalue()).decode()
    caption = f"<h2>{escape(heading)}</h2>" + (f'<p class="note">{escape(note)}</p>' if note else "")
    image = f'<img alt="{escape(alt)}" src="data:image/svg+xml;base64,{data}">'
    if figure.get_figwidth() > _WIDE_IN:  # a small screen shows a part of it at a time
        image = f'<div class="scroll wide">{image}</div>'
    return f"<figure><figcaption>{caption}</figcaption>{image}</figure>"


CSS = """
:root { --ink: #1b1f24; --soft: #5b636d; --line: #dfe3e8; --tint: #eef5fa; --accent: #0072b2; color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); font: 15px/1.5 "Helvetica Neue", Helvetica, Arial, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 32px 24px 64px; }
.kicker { margin: 0; color: var(--accent); font-weight: 700; letter-spacing: .08em; text-transform: uppercase;
  font-size: 12px; }
h1 { margin: 2px 0 12px; font-size: 26px; line-height: 1.2; }
h2 { margin: 0; font-size: 17px; }
.answer { margin: 0 0 24px; padding: 14px 18px; background: var(--tint); border-left: 4px solid var(--accent);
  font-size: 18px; line-height: 1.45; }
.note { margin: 4px 0 0; color: var(--soft); font-size: 13px; max-width: 125ch; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
.scores { width: 100%; }
.scores th, .scores td { padding: 7px 10px; text-align: right; vertical-align: top;
  border-bottom: 1px solid var(--line); white-space: nowrap; }
.scores thead th { color: var(--soft); font-size: 12.5px; font-weight: 600; vertical-align: bottom;
  white-space: normal; }
.scores thead .group { text-align: left; border-bottom: 2px solid var(--ink); color: var(--ink); }
.scores thead tr:last-child th { border-bottom: 1px solid var(--ink); }
.scores tbody th, .scores thead th[rowspan] { text-align: left; }
.scores small { display: block; color: var(--soft); font-weight: 400; font-size: 12px; }
.scores .place { color: var(--soft); font-size: 12.5px; line-height: 1.35; }
tr.best > * { background: var(--tint); }
.key { width: 11px; height: 11px; margin-right: 7px; }
.badge { display: inline-block; padding: 0 7px; margin-left: 3px; border-radius: 9px; background: var(--accent);
  color: #fff; font-size: 11px; font-weight: 600; line-height: 17px; }
.badge.warn { background: #fff; color: #8a3b00; border: 1px solid #d55e00; }
figure { margin: 36px 0 0; break-inside: avoid; }
figcaption { margin-bottom: 10px; }
img { display: block; width: 100%; height: auto; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(440px, 100%), 1fr)); column-gap: 32px; }
section { margin-top: 44px; padding-top: 20px; border-top: 1px solid var(--line); }
.facts { display: grid; grid-template-columns: max-content 1fr; gap: 4px 20px; margin: 12px 0 16px; font-size: 14px; }
.facts dt { color: var(--soft); }
.facts dd { margin: 0; overflow-wrap: anywhere; min-width: 0; }
pre { margin: 0; padding: 8px 12px; background: #f4f6f8; font-size: 13px; white-space: pre-wrap; }
details { margin-top: 8px; font-size: 14px; }
summary { cursor: pointer; font-weight: 600; }
.values { margin: 8px 0 0; font-size: 13px; }
.values th, .values td { padding: 2px 14px 2px 0; text-align: right; border-bottom: 1px solid var(--line); }
.values th[scope=row] { text-align: left; font-weight: 400; }
.look { display: flex; flex-wrap: wrap; align-items: center; gap: 6px 18px; margin: 10px 0; font-size: 14px; }
.look label { margin-right: 12px; white-space: nowrap; }
canvas { display: block; width: 100%; cursor: crosshair; touch-action: pan-y; }
#closer-time { height: 230px; }
#closer-path { height: 380px; }
@media (max-width: 640px) { main { padding: 20px 14px 40px; } .answer { font-size: 16px; }
  .facts { grid-template-columns: 1fr; } .facts dd { margin-bottom: 8px; } .wide img { width: 806px; max-width: none; }
  .scores th, .scores td { padding: 7px 6px; } .scores tbody small { display: none; } }
@media print { #closer { display: none; } .scroll { overflow: visible; } .facts { break-inside: avoid; }
  h2 { break-after: avoid; }
  main { max-width: none; padding: 0; } .pair { grid-template-columns: 1fr 1fr; }
  .answer, tr.best > *, .badge { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  details::details-content { content-visibility: visible; }
  details { columns: 3; font-size: 9px; } summary { column-span: all; list-style: none; } .values { font-size: 8px; }
  body { font-size: 11px; } .scores { font-size: 9px; } .scores th, .scores td { padding: 3px 4px; }
  .scores thead th, .scores small, .scores .place { font-size: 8px; } .scores th, .scores td { white-space: normal; } }
"""

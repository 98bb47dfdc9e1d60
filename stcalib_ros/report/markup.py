"""HTML with everything escaped: texts of a bag are anybody's."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

_STYLE = """\
:root { color-scheme: light dark; --ink: #22262b; --faint: #6b737c; --line: #dfe3e7;
  --paper: #ffffff; --good: #00795a; --bad: #b03a00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e7ea; --faint: #9aa3ab; --line: #3a4148;
  --paper: #16191c; --good: #3fc79a; --bad: #ff8a4c; } }
body { margin: 0 auto; max-width: 1120px; padding: 2rem 1.25rem 4rem; background: var(--paper);
  color: var(--ink); font: 15px/1.5 system-ui, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2.5rem 0 .5rem; }
p { max-width: 75ch; margin: .5rem 0; }
.good { color: var(--good); } .bad { color: var(--bad); }
.faint, figcaption { color: var(--faint); font-size: .88rem; }
figure { margin: 1rem 0; } figcaption { max-width: 90ch; margin-top: .4rem; }
img { display: block; width: 100%; height: auto; background: #fff; border: 1px solid var(--line);
  border-radius: 6px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .35rem 1.4rem .35rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; white-space: nowrap; }
th { color: var(--faint); font-weight: 600; }
td.wrap { white-space: normal; min-width: 24rem; }
"""


def page(title: str, parts: Iterable[str]) -> str:
    """Whole document; `parts` are markup."""
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def heading(text: str, *, good: bool) -> str:
    """Verdict at the top."""
    return f'<h1 class="{"good" if good else "bad"}">{escape(text)}</h1>'


def section(title: str, *parts: str) -> str:
    """Part of the page under its own title; `parts` are markup."""
    body = "\n".join(parts)
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}\n</section>"


def paragraph(text: str, *, faint: bool = False) -> str:
    """Paragraph of plain text."""
    return f"<p{' class=faint' if faint else ''}>{escape(text)}</p>"


def table(rows: Sequence[Sequence[str]], *, wrapped: Sequence[int] = ()) -> str:
    """Table of plain texts, the first row its head; columns in `wrapped` may break lines."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in rows[0])
    lines = [
        "".join(
            f"<td{' class=wrap' if i in wrapped else ''}>{escape(cell)}</td>"
            for i, cell in enumerate(row)
        )
        for row in rows[1:]
    ]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def image(png: bytes, alt: str, caption: str) -> str:
    """Picture that is part of the file."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img src="data:image/png;base64,{data}" alt="{escape(alt)}">\n'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )

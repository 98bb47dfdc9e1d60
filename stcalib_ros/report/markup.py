"""HTML with everything escaped: texts of a bag are anybody's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

DATA = Path(__file__).parents[1] / "data" / "report"
"""Style sheet and script of the page."""

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def page(title: str, parts: Iterable[str]) -> str:
    """Whole document, which may load nothing from anywhere; `parts` are markup."""
    body, style = "\n".join(parts), (DATA / "report.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def heading(text: str, *, good: bool) -> str:
    """Verdict at the top."""
    return f'<h1 class="{"good" if good else "bad"}">{escape(text)}</h1>'


def section(title: str, *parts: str) -> str:
    """Part of the page under its own title; `parts` are markup."""
    body = "\n".join(part for part in parts if part)
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}\n</section>"


def subtitle(text: str) -> str:
    """Title within a section."""
    return f"<h3>{escape(text)}</h3>"


def paragraph(text: str, *, faint: bool = False, lead: bool = False) -> str:
    """Paragraph of plain text."""
    kind = " class=faint" if faint else " class=lead" if lead else ""
    return f"<p{kind}>{escape(text)}</p>"


def side_by_side(*parts: str) -> str:
    """Markup in columns where there is room, else below each other."""
    return f'<div class="pair">\n{"".join(parts)}\n</div>' if parts else ""


def findings(items: Iterable[tuple[bool, str]]) -> str:
    """List of plain texts, each ticked or marked as weak."""
    lines = [f"<li{'' if good else ' class=weak'}>{escape(text)}</li>" for good, text in items]
    return '<ul class="findings">\n' + "\n".join(lines) + "\n</ul>" if lines else ""


def coded(items: Iterable[tuple[str, str]]) -> str:
    """List of plain texts, each with the code that files and messages carry."""
    lines = [f"<li>{escape(text)} <code>{escape(code)}</code></li>" for code, text in items]
    return '<ul class="plain">\n' + "\n".join(lines) + "\n</ul>" if lines else ""


def table(rows: Sequence[Sequence[str]]) -> str:
    """Table of plain texts, the first row its head; on a narrow screen, a block for each row."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in rows[0])
    lines = [
        "".join(
            f'<td data-head="{escape(name)}">{escape(cell)}</td>'
            for name, cell in zip(rows[0], row, strict=True)
        )
        for row in rows[1:]
    ]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def folded(title: str, *parts: str) -> str:
    """Markup that is shown when its title is clicked."""
    body = "\n".join(part for part in parts if part)
    return f"<details><summary>{escape(title)}</summary>\n{body}\n</details>"

"""Writes messages.md from the definitions of messages, services and actions.

python docs/messages.py
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
KINDS = {"msg": "Messages", "srv": "Services", "action": "Actions"}
HEAD = """\
# Messages, services and actions

The definitions, with what every field means. Which topic has which: [live.md](live.md). This page
is written by `python docs/messages.py`.
"""


def page() -> str:
    """Return the page."""
    parts = [HEAD]
    for kind, title in KINDS.items():
        parts.append(f"## {title}\n")
        for path in sorted((ROOT / kind).glob(f"*.{kind}")):
            text = path.read_text().strip()
            parts.append(f"### stcalib_ros/{kind}/{path.stem}\n\n```\n{text}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(page())

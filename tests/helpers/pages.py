"""The code blocks of the documentation: what stands in a page, in its order."""

from __future__ import annotations

import re
from typing import NamedTuple


class Block(NamedTuple):
    """One fenced block."""

    language: str
    text: str


def blocks(page: str) -> list[Block]:
    """All fenced blocks of a Markdown text."""
    return [
        Block(*found)
        for found in re.findall(r"^```(\w+)\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    ]


def fenced(page: str, language: str) -> str:
    """Those in one language, as one text."""
    return "\n".join(block.text for block in blocks(page) if block.language == language)


def lines(shell: str) -> list[str]:
    """The commands of a shell block, lines that go on joined."""
    return [line for line in shell.replace("\\\n", " ").splitlines() if line.strip()]

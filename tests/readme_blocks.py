"""The blocks of code in the README."""

from __future__ import annotations

import re


def blocks(readme: str, language: str) -> list[str]:
    """Return the blocks of one language, in order."""
    return re.findall(rf"```{language}\n(.*?)```", readme, flags=re.DOTALL)

"""Names of folders from words that anybody may have chosen."""

from __future__ import annotations

import re
from collections.abc import Sequence

from runner.storage.provenance import digest

LONGEST = 80  # characters: file systems take 255 bytes
DIGITS = 8  # of a hash: what is cut or spelled otherwise is told from others by them


def folder_name(words: Sequence[str]) -> str:
    """Return one name for some words: plain letters, digits, `_` and `+`, and another one for other words."""
    told = "+".join(words).replace("[*]", "_all").replace("[", "_").replace("]", "")
    plain = re.sub(r"[^A-Za-z0-9_+]", "_", told)
    return plain if plain == told and len(plain) <= LONGEST else f"{plain[:LONGEST]}_{digest(list(words))[:DIGITS]}"

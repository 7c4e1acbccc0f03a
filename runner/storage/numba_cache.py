"""What numba's cache on disk does not see by itself: that a file has changed which a compiled function calls into."""

from __future__ import annotations

import hashlib
from pathlib import Path


def fingerprint(*sources: str | Path) -> int:
    """Return a number that changes with the text of these files, below 2^60.

    Numba keeps a compiled function for as long as its own file does not change, and asks nothing of the files that its
    callees stand in. A function that holds this number of all of them in its closure is compiled anew after any change.
    """
    text = b"".join(Path(source).read_bytes() for source in sorted(map(str, sources)))
    return int(hashlib.sha256(text).hexdigest()[:15], 16)

"""The page's own files, read once: what is not in the table is not there, and no path is ever made of what is asked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from gzip import compress
from hashlib import sha256
from pathlib import Path

PAGE = Path(__file__).parent / "page"
INDEX, LOGIN = "index.html", "login.html"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
"""What is of another kind is not served."""


@dataclass(frozen=True, slots=True)
class Asset:
    """One file; `etag` is of its content, `gzipped` the same in less, b"" where it would not be."""

    body: bytes
    content_type: str
    etag: str
    gzipped: bytes = b""


@cache
def read_assets(folder: Path = PAGE) -> Mapping[str, Asset]:
    """All files below the folder by name, "vendor/three.module.min.js" with its folder. Raises OSError."""
    found = {}
    for path in sorted(folder.rglob("*")):
        content_type = TYPES.get(path.suffix)
        # A developer's, from which the vendored files are built; it is in no wheel.
        is_built_from = "node_modules" in path.parts
        if content_type and path.is_file() and not is_built_from:
            body = path.read_bytes()
            etag = f'"{sha256(body).hexdigest()[:32]}"'
            gzipped = compress(body, mtime=0) if len(body) > 1000 and path.suffix != ".png" else b""
            found[path.relative_to(folder).as_posix()] = Asset(body, content_type, etag, gzipped)
    return found

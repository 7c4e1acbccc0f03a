"""What `make site` does besides mkdocs: pages that lie outside of docs/ are in the site, and links lead to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = {"examples.md": "examples/README.md", "changelog.md": "CHANGELOG.md"}


def on_files(files: Files, config: Any) -> Files:
    """Add the pages from outside."""
    for name, path in OUTSIDE.items():
        files.append(File.generated(config, name, content=(ROOT / path).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead links of pages to the site's places."""
    for name, linked in OUTSIDE.items():
        markdown = markdown.replace(f"](../{linked}", f"]({name}")
    if page.file.src_uri in OUTSIDE:  # its links are those of its own place
        markdown = markdown.replace("](../docs/", "](").replace("](docs/", "](")
    return markdown


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Take the script by which the search works from the disk from beside the pages, not from the network."""
    up = "../" * page.file.src_uri.count("/")
    return output.replace("https://unpkg.com/iframe-worker/shim", f"{up}assets/offline_search.js")

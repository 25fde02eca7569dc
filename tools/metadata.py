"""Metadata of the package beyond pyproject.toml: its addresses, and the README with links to them.

The project's address is git's remote `origin` of the clone in which the package is built. Without a remote, or if its
host is not public, a package has no address, links in its README are plain words, and pictures are left out. Hatchling
runs this; a source package keeps the metadata with which it was made.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)]*)\)")  # except links that are absolute already
SCHEMES = ("https", "http", "ssh", "git")
BETWEEN = re.compile(r"\n{3,}")  # empty lines that pictures leave behind


class ProjectHook(MetadataHookInterface):
    """Adds `urls` and `readme`."""

    def update(self, metadata: dict[str, Any]) -> None:
        address = web_address(origin(Path(self.root)))
        text = linked((Path(self.root) / "README.md").read_text(encoding="utf-8"), address)
        metadata.setdefault("readme", {"content-type": "text/markdown", "text": text})
        if address:
            metadata.setdefault("urls", urls(address))


def origin(root: Path) -> str:
    """Address that a clone came from; empty if there is none."""
    if not (root / ".git").exists():
        return ""
    try:
        asked = ["git", "-C", str(root), "config", "--get", "remote.origin.url"]
        return subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    except OSError:  # git is not installed
        return ""


def web_address(remote: str) -> str | None:
    """Page of a remote repository, without user name or password; None if its host is not public."""
    short = re.fullmatch(r"[\w.-]+@([\w.-]+):([\w./~-]+)", remote)  # git@host:owner/name.git
    parts = urlsplit(f"ssh://{short[1]}/{short[2]}" if short else remote)
    path = parts.path.strip("/").removesuffix(".git")
    host = parts.hostname or ""
    is_public = "." in host and not re.fullmatch(r"[\d.]+", host) and parts.scheme in SCHEMES
    return f"https://{host}/{path}" if is_public and path else None


def urls(address: str) -> dict[str, str]:
    """Addresses of a package, by the names that package indexes use."""
    file = f"{address}/blob/HEAD"
    return {
        "Source": address,
        "Documentation": f"{file}/docs/index.md",
        "Changelog": f"{file}/CHANGELOG.md",
        "Issues": f"{address}/issues",
    }


def linked(readme: str, address: str | None) -> str:
    """The README for readers outside of the repository."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, path = link.groups()
        if address is None:
            return "" if picture else words
        return f"{picture}[{words}]({address}/{'raw' if picture else 'blob'}/HEAD/{path})"

    return BETWEEN.sub("\n\n", LINK.sub(absolute, readme))

"""Adds metadata that is not in pyproject.toml: the project's web addresses, and the README with absolute links.

Hatchling runs this when a package is built. The project's address is the clone's remote `origin`. Without a remote, or
if its host is not public, the package has no addresses, and its README has words in place of links, and no pictures.
A source package contains finished metadata.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:)([^)]*)\)")  # a link or a picture, unless it is absolute
SCHEMES = ("https", "http", "ssh", "git")
BETWEEN = re.compile(r"\n{3,}")  # empty lines where pictures were removed


class ProjectHook(MetadataHookInterface):
    """Adds `urls` and `readme` to the metadata."""

    def update(self, metadata: dict[str, Any]) -> None:
        address = web_address(origin(Path(self.root)))
        text = linked((Path(self.root) / "README.md").read_text(encoding="utf-8"), address)
        metadata.setdefault("readme", {"content-type": "text/markdown", "text": text})
        if address:
            metadata.setdefault("urls", urls(address))


def origin(root: Path) -> str:
    """Address of a clone's remote `origin`; empty if there is none."""
    if not (root / ".git").exists():
        return ""
    try:
        asked = ["git", "-C", str(root), "config", "--get", "remote.origin.url"]
        return subprocess.run(asked, capture_output=True, text=True).stdout.strip()
    except OSError:  # git is not installed
        return ""


def web_address(remote: str) -> str | None:
    """Web page of a remote repository, without user name or password; None if its host is not public."""
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
    """Make the README's links absolute, or remove them if there is no address."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, path = link.groups()
        if address is None:
            return "" if picture else words
        return f"{picture}[{words}]({address}/{'raw' if picture else 'blob'}/HEAD/{path})"

    return BETWEEN.sub("\n\n", LINK.sub(absolute, readme))

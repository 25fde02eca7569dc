"""The manifest of a batch: files and checksums of each task, in parts that are never changed."""

from __future__ import annotations

import hashlib
import json
import time
import uuid
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, TypedDict

from pyibr.app.batch.job import Task
from pyibr.core.optional import fsspec

FOLDER = "manifest"
PART = ".part-"  # prefix of the folders that workers write in
_FAILED = "failed.json"
_ODD = (ValueError, TypeError, LookupError, AttributeError, RecursionError)  # raised by lines that are no entries
_SECONDS = 5.0  # between a task's end and its entry in the manifest: a crash repeats at most so much work


class Entry(TypedDict):
    """Files of a finished task."""

    name: str
    key: str
    files: dict[str, tuple[int, str]]  # size and SHA-256, by path below the output


class Manifest:
    """Entries of an output folder, from earlier runs and new.

    Cluster file systems write whole files and do not append, so entries are written in parts, as lines of JSON.
    """

    def __init__(self, output: str) -> None:
        self._files, self._root = fsspec().url_to_fs(output)
        self._parts = f"{self._root}/{FOLDER}"
        self._new: list[Entry] = []
        self._written = time.monotonic()
        self._entries: dict[str, Entry] = {}
        self._sizes: dict[str, int] = {}
        self._files.makedirs(self._parts, exist_ok=True)
        for path, info in self._files.find(self._root, detail=True).items():
            self._sizes[path] = info["size"]
        for part in sorted(self._files.glob(f"{self._parts}/*.jsonl")):
            for line in self._files.cat_file(part).splitlines():
                with suppress(*_ODD):  # the last line, cut off on a full disk, or a line of another program
                    told = json.loads(line)
                    files = {path: (size, digest) for path, (size, digest) in told["files"].items()}
                    self._entries[told["name"]] = {"name": told["name"], "key": told["key"], "files": files}

    def has(self, task: Task, verify: bool) -> bool:
        """Tell whether the task is done and its files have the right size, and with `verify` the right checksum."""
        entry = self._entries.get(task.name)
        if entry is None or entry["key"] != task.key:
            return False
        paths = {f"{self._root}/{path}": told for path, told in entry["files"].items()}
        return all(self._sizes.get(path) == size for path, (size, _) in paths.items()) and not (
            verify and any(checksum(self._files, path) != digest for path, (_, digest) in paths.items())
        )

    def add(self, entry: Entry) -> None:
        """Record a finished task."""
        self._new.append(entry)
        if time.monotonic() - self._written > _SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write pending entries; keep them for later if the disk is full."""
        lines = "".join(json.dumps(entry) + "\n" for entry in self._new)
        with suppress(OSError):
            if lines:
                name = f"{time.time_ns():020d}-{uuid.uuid4().hex[:8]}"
                self._files.pipe_file(f"{self._parts}/{name}.jsonl", lines.encode())
            self._new.clear()
        self._written = time.monotonic()

    def close(self, failed: Mapping[str, str]) -> None:
        """Write pending entries and failures; remove folders of killed workers."""
        self.flush()
        with suppress(OSError):
            for part in self._files.glob(f"{self._root}/{PART}*"):
                self._files.rm(part, recursive=True)
            self._files.pipe_file(f"{self._parts}/{_FAILED}", json.dumps(failed, indent=1).encode())


def checksum(files: Any, path: str) -> str:
    """SHA-256 of a file, in hexadecimal."""
    digest = hashlib.sha256()
    with files.open(path, "rb") as stream:
        while data := stream.read(1 << 20):
            digest.update(data)
    return digest.hexdigest()

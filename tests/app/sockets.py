"""Finds the addresses on which a process listens."""

from __future__ import annotations

from pathlib import Path

LOOPBACK = {"0100007F"}
"""127.0.0.1, in the format of `listeners`."""


def listeners(pid: int | str = "self") -> set[str]:
    """Addresses on which a process listens, as /proc writes them: hexadecimal, with the last byte of IPv4 first."""
    own: set[str] = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            own.add(str(link.readlink()))
        except FileNotFoundError:  # the descriptor by which the folder was listed is closed by now
            continue
    found: set[str] = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == "0A" and f"socket:[{columns[9]}]" in own:
                found.add(columns[1].split(":")[0])
    return found

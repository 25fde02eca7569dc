"""Installed distributions: pyibr's own, and those that write into the same folder."""

from __future__ import annotations

PYIBR = "pyibr-opencl"
"""Name on package indexes, where another project is called pyibr."""

_OWNERS = {  # by their folder; the first is the one to keep
    "pyibr": (PYIBR, "pyibr"),
    "cv2": ("opencv-contrib-python", "opencv-python", "opencv-contrib-python-headless", "opencv-python-headless"),
}


def version_of(distribution: str) -> str | None:
    """The version of an installed distribution, or None."""
    from importlib import metadata

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def clashes() -> list[tuple[str, str]]:
    """(problem, command that repairs it) for distributions that have overwritten each other's files."""
    found: list[tuple[str, str]] = []
    for folder, names in _OWNERS.items():
        owners = [name for name in names if _writes_into(name, folder)]
        if len(owners) > 1:
            kept, *others = owners
            what = f"{' and '.join(owners)} have both written into {folder}/: removing one breaks the other"
            mend = f"pip install --force-reinstall --no-deps {kept}=={version_of(kept)}"
            found.append((what, f"pip uninstall -y {' '.join(others)} && {mend}"))
    return found


def _writes_into(distribution: str, folder: str) -> bool:
    from importlib import metadata

    try:
        files = metadata.files(distribution)
    except metadata.PackageNotFoundError:
        return False
    return any(file.parts[0] == folder for file in files or ())

"""Files: path types, and atomic writing."""

from __future__ import annotations

import os

PathLike = str | os.PathLike[str]


def write_whole(path: PathLike, document: bytes) -> None:
    """Writes a file, completely or not at all."""
    temporary = f"{os.fspath(path)}.{os.getpid()}.tmp"
    try:
        with open(temporary, "wb") as file:
            file.write(document)
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)

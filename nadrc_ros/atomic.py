"""Files that are there in full or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import errno
import json
import os
from pathlib import Path
from typing import Any


def check_folder(path: Path) -> None:
    """
    Refuse a folder that cannot be made or written, before work is done for it.

    Raises
    ------
    OSError
        Names the file in its place, or the folder that may not be written.

    """
    whole = path.absolute()
    there = next(each for each in (whole, *whole.parents) if each.exists())
    if not there.is_dir():
        raise OSError(errno.ENOTDIR, 'is a file, not a folder', str(there))
    if not os.access(there, os.W_OK):
        raise OSError(errno.EACCES, 'this folder cannot be written', str(there))


def check_file(path: Path) -> None:
    """Refuse a file that cannot be written, as :func:`check_folder` does."""
    if path.is_dir():
        raise OSError(errno.EISDIR, 'is a folder, not a file', str(path))
    if path.exists() and not path.is_file():
        return  # as /dev/null
    if not path.absolute().parent.exists():
        raise OSError(errno.ENOENT, 'there is no such folder', str(path.absolute().parent))
    check_folder(path.parent)


def write_whole(path: Path, content: bytes) -> None:
    """
    Write beside the file and rename, so that no reader sees half of it.

    What exists and is not a plain file, such as /dev/null, is written to directly.
    """
    path = path.resolve()
    if path.exists() and not path.is_file():
        path.write_bytes(content)
        return
    part = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise OSError(error.errno, 'there is no such folder', str(path.parent)) from None
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        with suppress(OSError):
            part.unlink()


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a document of finite numbers in full, or not at all."""
    write_whole(path, (json.dumps(content, indent=2, allow_nan=False) + '\n').encode())

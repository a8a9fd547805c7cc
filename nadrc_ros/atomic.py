"""Files that are there in full or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import errno
import json
import os
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.errors import UserError

# The key of a document that says what it is.
FORMAT = 'format'


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


def write_json(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write a document of finite numbers in full, or not at all; its format comes first."""
    document = {FORMAT: format_of(kind), **content}
    write_whole(path, (json.dumps(document, indent=2, allow_nan=False) + '\n').encode())


def format_of(kind: str) -> str:
    """Return what a JSON document of a kind says of its format."""
    return f'nadrc/{kind} 1'


def content_of(name: str, kind: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return what a document has beside its format, which must be that of the kind.

    One that does not say what it is was written before documents said it, and passes.

    Raises
    ------
    UserError
        Names the file, what it is, and what can be read.

    """
    known = format_of(kind)
    content = dict(document)
    found = content.pop(FORMAT, known)
    if found == known:
        return content
    later = str(found).startswith(known[:-1])
    hint = ': a later version of nadrc_ros wrote it' if later else ''
    raise UserError(f'{name}: its format is {found}, not {known}{hint}')

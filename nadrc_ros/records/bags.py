"""
Signals from a rosbag2 bag, sqlite3 or mcap, read without ROS.

A message of a signal holds one number in ``data``, as those of std_msgs. It has no stamp, so its
time is that at which the bag received it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
import re
from shutil import copyfileobj
import sqlite3
from tempfile import TemporaryDirectory
from typing import Any

from nadrc_ros.adrc.errors import did_you_mean
from nadrc_ros.extras import MissingPackage
from nadrc_ros.records.recording import RecordingError, topic_of
from nadrc_ros.records.source import Array, REQUIRED, rows_of, SIGNALS, Source
import numpy as np

_BAG_ENDINGS = ('.db3', '.mcap', '.db3.zstd', '.mcap.zstd')
_NUMBER_TYPES = re.compile(r'std_msgs/msg/(Float|U?Int)\d+')


def is_bag(path: Path) -> bool:
    """Tell whether ``path`` is the file of a bag, or a folder that holds one."""
    return any(
        each.name.endswith(_BAG_ENDINGS) for each in (path.iterdir() if path.is_dir() else [path])
    )


def read_bag(path: Path, source: Source) -> tuple[dict[str, Array], float]:
    """
    Return the signals of a bag on the times of its measurements and its end: :func:`rows_of`.

    Raises
    ------
    RecordingError
        When it cannot be read, a signal has several topics or no numbers, or measurement or
        command is missing.

    """
    if source.time or source.time_unit:
        raise RecordingError(
            'a bag has times of its own; --time and --time-unit are for CSV files'
        )
    with _plain(path) as plain:
        received = _received(plain, source)
    start = min(rows[0][0] for rows in received.values())
    return rows_of(
        {
            name: np.array([1e-9 * (row[0] - start) for row in rows])
            for name, rows in received.items()
        },
        {name: np.array([row[1] for row in rows]) for name, rows in received.items()},
    )


def _received(path: Path, source: Source) -> dict[str, list[tuple[int, float]]]:
    """Return stamp [ns] and value of all messages of each signal, in the order of the stamps."""
    reader, failures = _reader(path)
    try:
        with reader:
            chosen = _choose({link.topic: link.msgtype for link in reader.connections}, source)
            found: dict[str, list[tuple[int, float]]] = {name: [] for name in chosen}
            of = {topic: name for name, topic in chosen.items()}
            wanted = [link for link in reader.connections if link.topic in of]
            for link, stamp, raw in reader.messages(connections=wanted):
                message = reader.deserialize(raw, link.msgtype)
                found[of[link.topic]].append((stamp, _number(message, link)))
    except RecordingError:
        raise
    except failures as error:
        raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None
    for name in REQUIRED:
        if not found[name]:
            raise RecordingError(f'no message on {chosen[name]}')
    return {name: sorted(rows, key=lambda row: row[0]) for name, rows in found.items() if rows}


def _reader(path: Path) -> tuple[Any, tuple[type[Exception], ...]]:
    """Return a reader, and what it raises for files that are broken."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise MissingPackage('reading a bag', 'rosbags', 'bags') from None
    broken = (
        *(AnyReaderError, sqlite3.Error, ValueError, KeyError, IndexError, AssertionError),
        *(each.ZstdError for each in _zstd()),
    )
    try:
        store = get_typestore(Stores.ROS2_JAZZY)
        return AnyReader([path], default_typestore=store), broken
    except broken as error:
        raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None


@contextmanager
def _plain(path: Path) -> Iterator[Path]:
    """Give what can be read of a file that was compressed as a whole, or of any other."""
    file = _file_of(path)
    if file.suffix != '.zstd':
        yield file
        return
    for zstd in _zstd():
        with TemporaryDirectory() as folder:
            plain = Path(folder, file.stem)
            try:
                with zstd.open(file) as packed, plain.open('wb') as out:
                    copyfileobj(packed, out)
            except (zstd.ZstdError, EOFError) as error:
                raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None
            yield plain
        return
    raise MissingPackage('reading .zstd', 'backports.zstd', 'backports.zstd')


def _zstd() -> list[Any]:
    """Return the module for Zstandard, of Python 3.14 or the one that comes with rosbags."""
    for name in ('compression.zstd', 'backports.zstd'):
        with suppress(ImportError):
            return [import_module(name)]
    return []


def _file_of(path: Path) -> Path:
    """Return the file of a folder without metadata, as a recording that was killed leaves it."""
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return path
    files = sorted(each for each in path.iterdir() if each.name.endswith(_BAG_ENDINGS))
    if len(files) > 1:
        raise RecordingError('no metadata.yaml and several files: name one of them')
    return files[0]


def _choose(existing: Mapping[str, str], source: Source) -> dict[str, str]:
    """Return the topic of each signal that the bag has, of all its topics with their types."""
    chosen = dict(source.signals)
    for topic in chosen.values():
        if topic not in existing:
            raise RecordingError(f'no topic {topic}: {did_you_mean(topic, sorted(existing))}')
    prefix = '/' + source.namespace.strip('/') if source.namespace.strip('/') else ''
    if not prefix and not set(REQUIRED) <= chosen.keys():
        prefix = _only_namespace(set(existing), next(n for n in REQUIRED if n not in chosen))
    for name in SIGNALS:
        topic = f'{prefix}/{topic_of(name)}'
        if name not in chosen and topic in existing:
            chosen[name] = topic
    for name in REQUIRED:
        if name not in chosen:
            numbers = [t for t, kind in existing.items() if _NUMBER_TYPES.fullmatch(kind)]
            listed = ', '.join(sorted(set(numbers) - set(chosen.values()))) or 'no topic'
            raise RecordingError(
                f'no topic {prefix}/{name}: name that of the {name} with --{name}; one number '
                f'each have {listed}'
            )
    return chosen


def _only_namespace(existing: set[str], name: str) -> str:
    """Return the namespace of the only topic of that name, '' if it has none or is missing."""
    ending = f'/{name}'
    if ending in existing:
        return ''
    found = sorted(topic for topic in existing if topic.endswith(ending))
    if len(found) > 1:
        raise RecordingError(f'several loops, {", ".join(found)}: name the namespace of one')
    return found[0].removesuffix(ending) if found else ''


def _number(message: Any, link: Any) -> float:
    with suppress(AttributeError, TypeError, ValueError):
        return float(message.data)
    raise RecordingError(f'{link.topic} has {link.msgtype}, not one number as std_msgs/Float64')


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__

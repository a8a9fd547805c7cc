"""
Signals from a rosbag2 bag, sqlite3 or mcap, read without ROS.

A message of a signal holds one number in ``data``, as those of std_msgs. It has no stamp, so its
time is that at which the bag received it.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
import sqlite3
from typing import Any

from nadrc_ros.adrc.settings import MAX_LEVELS
from nadrc_ros.records.recording import ESTIMATES, NEEDED, RecordingError, topic_of, TRUTH
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
SUFFIXES = ('.db3', '.mcap')
LEVELS = tuple(f'level_{k}' for k in range(1, MAX_LEVELS + 1))
SIGNALS = (*NEEDED, *TRUTH, *ESTIMATES, *LEVELS)
REQUIRED = ('measurement', 'command')


def is_bag(path: Path) -> bool:
    """Tell whether ``path`` is the file of a bag, or a folder that holds one."""
    if path.is_dir():
        return any(each.suffix in SUFFIXES for each in path.iterdir())
    return path.suffix in SUFFIXES


def read_bag(
    path: Path, topics: Mapping[str, str] | None = None, namespace: str = ''
) -> dict[str, Array]:
    """
    Return the signals of a bag on the times of its measurements, as the recorder would.

    A row belongs to one measurement and holds the last value of every other signal that was
    received before the next measurement: zero-order hold, and for the command the one that acted
    meanwhile. The first row is the first measurement with a command, at ``time`` 0.

    Parameters
    ----------
    path
        The folder of a bag, or its only file.
    topics
        The topic of a signal by its column, where it is not that of this package's nodes.
    namespace
        Of the loop. If empty, the one whose topics there are.

    Raises
    ------
    RecordingError
        When it cannot be read, a signal has several topics or no numbers, or measurement or
        command is missing.

    """
    stamps, values = _received(path, topics or {}, namespace)
    grid = stamps['measurement']
    ends = np.append(grid[1:], np.iinfo(np.int64).max)
    columns = {
        name: _last_before(ends, stamps[name], values[name]) for name in SIGNALS if name in stamps
    }
    columns['measurement'] = values['measurement']
    first = int(np.searchsorted(ends, stamps['command'][0], 'right'))
    time = (grid[first:] - grid[first]) * 1e-9
    return {'time': time, **{name: column[first:] for name, column in columns.items()}}


def _last_before(ends: npt.NDArray[np.int64], stamps: npt.NDArray[np.int64], values: Array) -> Any:
    index = np.searchsorted(stamps, ends, 'left') - 1
    return np.where(index >= 0, values[np.maximum(index, 0)], np.nan)


def _received(path: Path, topics: Mapping[str, str], namespace: str) -> tuple[Any, Any]:
    """Return stamps [ns] and values of each signal, in the order of the stamps."""
    reader, failures = _reader(path)
    try:
        with reader:
            chosen = _choose(set(reader.topics), topics, namespace)
            found: dict[str, list[tuple[int, float]]] = {name: [] for name in chosen}
            of = {topic: name for name, topic in chosen.items()}
            wanted = [link for link in reader.connections if link.topic in of]
            for link, stamp, raw in reader.messages(connections=wanted):
                message = reader.deserialize(raw, link.msgtype)
                found[of[link.topic]].append((stamp, _number(message, link)))
    except failures as error:
        raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None
    for name in REQUIRED:
        if not found[name]:
            raise RecordingError(f'no message on {chosen[name]}')
    stamps, values = {}, {}
    for name, rows in found.items():
        if rows:
            rows.sort(key=lambda row: row[0])
            stamps[name] = np.array([row[0] for row in rows], dtype=np.int64)
            values[name] = np.array([row[1] for row in rows])
    return stamps, values


def _reader(path: Path) -> tuple[Any, tuple[type[Exception], ...]]:
    """Return a reader, and what it raises for files that are broken."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise RecordingError(
            'reading a bag takes the Python package rosbags: pip install rosbags'
        ) from None
    broken = (AnyReaderError, sqlite3.Error, ValueError, KeyError, IndexError, AssertionError)
    try:
        store = get_typestore(Stores.ROS2_JAZZY)
        return AnyReader([_file_of(path)], default_typestore=store), broken
    except broken as error:
        raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None


def _file_of(path: Path) -> Path:
    """Return the file of a folder without metadata, as a recording that was killed leaves it."""
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return path
    files = sorted(each for each in path.iterdir() if each.suffix in SUFFIXES)
    if len(files) > 1:
        raise RecordingError('no metadata.yaml and several files: name one of them')
    return files[0]


def _choose(existing: set[str], topics: Mapping[str, str], namespace: str) -> dict[str, str]:
    """Return the topic of each signal that the bag has."""
    for name, topic in topics.items():
        if name not in SIGNALS:
            raise RecordingError(f'{name} is no signal; those are {", ".join(SIGNALS)}')
        if topic not in existing:
            raise RecordingError(f'no topic {topic}; there are {_listed(existing)}')
    chosen = dict(topics)
    prefix = '/' + namespace.strip('/') if namespace.strip('/') else ''
    if not prefix and not set(REQUIRED) <= chosen.keys():
        prefix = _only_namespace(existing, next(n for n in REQUIRED if n not in chosen))
    for name in SIGNALS:
        topic = f'{prefix}/{topic_of(name)}'
        if name not in chosen and topic in existing:
            chosen[name] = topic
    for name in REQUIRED:
        if name not in chosen:
            raise RecordingError(f'no topic {prefix}/{name}; there are {_listed(existing)}')
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


def _listed(topics: set[str]) -> str:
    return ', '.join(sorted(topics)) or 'none'


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__

"""
Signals from a rosbag2 bag, sqlite3 or mcap, read without ROS.

A message of a signal holds one number in ``data``, as those of std_msgs, or is of any type where
an address says which number in it. Its time is that at which the bag received it: commands have
no stamp, as a rule, and times of two clocks do not mix.
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

import attrs
from nadrc_ros.adrc.errors import did_you_mean
from nadrc_ros.extras import MissingPackage
from nadrc_ros.records.recording import RecordingError, topic_of
from nadrc_ros.records.source import Array, REQUIRED, rows_of, SIGNALS, Source
from nadrc_ros.wiring.address import Address, AddressError, full_type, parse_address, parse_path
from nadrc_ros.wiring.layout import Malformed, MembersOf, Unsupported
from nadrc_ros.wiring.listing import numbers_in
from nadrc_ros.wiring.reader import Reader
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
    received = _received(path, source)
    start = min(rows[0][0] for rows in received.values())
    return rows_of(
        {
            name: np.array([1e-9 * (row[0] - start) for row in rows])
            for name, rows in received.items()
        },
        {name: np.array([row[1] for row in rows]) for name, rows in received.items()},
    )


def fields_in(path: Path, topic: str = '') -> Iterator[tuple[str, str, list[tuple[str, float]]]]:
    """
    Yield topic, type and every number with its field, of the first message of each topic.

    Raises
    ------
    RecordingError
        When the bag cannot be read, or has not the topic that was asked for.

    """
    with opened(path) as reader:
        there = sorted({link.topic for link in reader.connections})
        if topic and topic not in there:
            raise RecordingError(f'no topic {topic}: {did_you_mean(topic, there)}')
        members_of = members_in(reader)
        for name in [topic] if topic else there:
            links = [link for link in reader.connections if link.topic == name]
            for link, _, raw in reader.messages(connections=links):
                with suppress(LookupError, Malformed, Unsupported):
                    yield name, link.msgtype, list(numbers_in(raw, link.msgtype, members_of))
                break


def _received(path: Path, source: Source) -> dict[str, list[tuple[int, float]]]:
    """Return stamp [ns] and value of all messages of each signal, in the order of the stamps."""
    with opened(path) as reader:
        types = {link.topic: link.msgtype for link in reader.connections}
        chosen = _choose(types, source)
        readers: dict[str, list[tuple[str, Reader]]] = {}
        for name, address in chosen.items():
            entry = name, _reader_of(address, types[address.topic], members_in(reader))
            readers.setdefault(address.topic, []).append(entry)
        found: dict[str, list[tuple[int, float]]] = {name: [] for name in chosen}
        wanted = [link for link in reader.connections if link.topic in readers]
        for link, stamp, raw in reader.messages(connections=wanted):
            for name, reads in readers[link.topic]:
                value = reads.read(raw)
                if value is not None:
                    found[name].append((stamp, value))
    for name in REQUIRED:
        if not found[name]:
            raise RecordingError(f'no message on {chosen[name].topic}')
    return {name: sorted(rows, key=lambda row: row[0]) for name, rows in found.items() if rows}


def _reader_of(address: Address, kind: str, members_of: MembersOf) -> Reader:
    """Return what reads a signal; on a topic alone, the only number of its messages."""
    if address.message_type not in ('', kind):
        raise RecordingError(f'{address.topic} has {kind}, not {address.message_type}')
    named = address.path
    if not named and not _NUMBER_TYPES.fullmatch(kind):
        raise RecordingError(
            f'{address.topic} has {kind}, not one number as std_msgs/Float64: name a field of it '
            'as nadrc fields lists them'
        )
    try:
        return Reader(attrs.evolve(address, path=named or parse_path('data')), kind, members_of)
    except AddressError as error:
        raise RecordingError(str(error)) from None


def members_in(reader: Any) -> MembersOf:
    """Return what tells the members of the message types in a bag."""
    types = reader.typestore.fielddefs

    def written(kind: Any) -> str:
        node, of = kind
        if node.name in ('BASE', 'NAME'):
            return str(of[0] if node.name == 'BASE' else of)
        element, count = written(of[0]), of[1]
        return f'{element}[{count}]' if node.name == 'ARRAY' else f'sequence<{element}>'

    return lambda name: {member: written(kind) for member, kind in types[full_type(name)][1]}


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """
    Give the reader of a bag while it is open.

    Raises
    ------
    RecordingError
        When the file cannot be read, here or in the ``with`` block.

    """
    with _plain(path) as plain:
        reader, failures = _reader(plain)
        try:
            with reader:
                yield reader
        except RecordingError:
            raise
        except failures as error:
            raise RecordingError(f'not a bag that can be read: {_one_line(error)}') from None


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


def _choose(existing: Mapping[str, str], source: Source) -> dict[str, Address]:
    """Return where each signal is that the bag has, of all its topics with their types."""
    chosen = {name: _address(text) for name, text in source.signals.items()}
    for address in chosen.values():
        if address.topic not in existing:
            raise RecordingError(
                f'no topic {address.topic}: {did_you_mean(address.topic, sorted(existing))}'
            )
    prefix = '/' + source.namespace.strip('/') if source.namespace.strip('/') else ''
    if not prefix and not set(REQUIRED) <= chosen.keys():
        prefix = _only_namespace(set(existing), next(n for n in REQUIRED if n not in chosen))
    for name in SIGNALS:
        topic = f'{prefix}/{topic_of(name)}'
        if name not in chosen and topic in existing:
            chosen[name] = Address(topic)
    for name in REQUIRED:
        if name not in chosen:
            numbers = [t for t, kind in existing.items() if _NUMBER_TYPES.fullmatch(kind)]
            taken = {address.topic for address in chosen.values()}
            listed = ', '.join(sorted(set(numbers) - taken)) or 'no topic'
            raise RecordingError(
                f'no topic {prefix}/{name}: name that of the {name} with --{name}; one number '
                f'each have {listed}'
            )
    return chosen


def _address(text: str) -> Address:
    """Return a topic alone, or what names a field of its messages."""
    try:
        return parse_address(text) if len(text.split()) > 1 else Address(text)
    except AddressError as error:
        raise RecordingError(str(error)) from None


def _only_namespace(existing: set[str], name: str) -> str:
    """Return the namespace of the only topic of that name, '' if it has none or is missing."""
    ending = f'/{name}'
    if ending in existing:
        return ''
    found = sorted(topic for topic in existing if topic.endswith(ending))
    if len(found) > 1:
        raise RecordingError(f'several loops, {", ".join(found)}: name the namespace of one')
    return found[0].removesuffix(ending) if found else ''


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__

"""Bags as `ros2 bag record` makes them, written by the package rosbags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

START = 1_700_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
FLOAT64 = 'std_msgs/msg/Float64'
STRING = 'std_msgs/msg/String'


def write_bag(
    path: Path,
    signals: Mapping[str, Sequence[tuple[float, float]]],
    mcap: bool = False,
    words: Sequence[str] = (),
    compressed: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write (time [s], value) pairs of each topic, and a text on each topic in ``words``."""
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    number, text = STORE.types[FLOAT64], STORE.types[STRING]
    made = Writer(path, version=9, storage_plugin=plugin)
    if compressed != CompressionMode.NONE:
        made.set_compression(compressed, CompressionFormat.ZSTD)
    with made as writer:
        for topic in words:
            link = writer.add_connection(topic, STRING, typestore=STORE)
            writer.write(link, START, STORE.serialize_cdr(text(data='hello'), STRING))
        messages = []
        for topic, pairs in signals.items():
            link = writer.add_connection(topic, FLOAT64, typestore=STORE)
            messages += [(START + round(t * 1e9), link, value) for t, value in pairs]
        for stamp, link, value in sorted(messages, key=lambda m: m[0]):
            writer.write(link, stamp, STORE.serialize_cdr(number(data=value), FLOAT64))
    return path

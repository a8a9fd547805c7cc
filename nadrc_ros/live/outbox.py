"""What waits to be sent to one page: little, however slow that page is."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
import json
from math import isfinite
from typing import Any

from nadrc_ros.live.blocks import Array, DROPPED, pack

# So many blocks and messages wait; of blocks the oldest goes then, of messages the page.
BLOCKS, MESSAGES = 20, 500
# Only the newest message of these types matters.
_LATEST = ('state', 'comparison', 'operator', 'guard')

Message = dict[str, Any]
Write = Callable[[str | bytes], Awaitable[None]]


class Full(Exception):
    """A page takes no messages: it is to be closed."""


class Outbox:
    """
    The messages and blocks for one page, sent one by one as fast as it takes them.

    Messages go first. Blocks are numbered as they are sent, so that a page knows that it has all
    which were not marked as dropped.
    """

    def __init__(self, write: Write) -> None:
        self._write = write
        self._messages: deque[str] = deque()
        self._latest: dict[str, str] = {}
        self._blocks: deque[tuple[int, Array]] = deque()
        self._dropped = False
        self._sequence = 0
        self._there = asyncio.Event()

    def tell(self, message: Message) -> None:
        """
        Add a message.

        Raises
        ------
        Full
            When too many wait.

        """
        text = as_json(message)
        if message['type'] in _LATEST:
            self._latest[message['type']] = text
        elif len(self._messages) >= MESSAGES:
            raise Full
        else:
            self._messages.append(text)
        self._there.set()

    def add(self, rows: Array, flags: int = 0) -> None:
        """Add a block; the oldest one is dropped if too many wait."""
        if len(self._blocks) >= BLOCKS:
            self._blocks.popleft()
            self._dropped = True
        self._blocks.append((flags, rows))
        self._there.set()

    def forget_blocks(self) -> None:
        """Drop all blocks: the columns are others from now on."""
        self._dropped = self._dropped or bool(self._blocks)
        self._blocks.clear()

    async def run(self) -> None:
        """Send for as long as that is possible."""
        while True:
            await self._there.wait()
            await self._write(self._next())

    def _next(self) -> str | bytes:
        if self._messages:
            found: str | bytes = self._messages.popleft()
        elif self._latest:
            found = self._latest.pop(next(iter(self._latest)))
        else:
            flags, rows = self._blocks.popleft()
            found = pack(self._sequence, flags | (DROPPED if self._dropped else 0), rows)
            self._sequence += 1
            self._dropped = False
        if not (self._messages or self._latest or self._blocks):
            self._there.clear()
        return found


def as_json(message: Any) -> str:
    """Return a message as JSON, which has no NaN: null stands for it."""
    return json.dumps(_plain(message), allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return value

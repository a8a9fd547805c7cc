"""Changes of the controller's parameters by pages: one at a time, all or nothing, and undone."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.monitor import Monitor
from nadrc_ros.live.peer import Done, Peer
from nadrc_ros.live.undo import Undo, Values

# A node answers within so long, or not at all [s].
_ANSWER = 3.0


class Refused(UserError):
    """A node refused values; ``refused`` is the name of the one that its reason names."""

    def __init__(self, reason: str, values: Mapping[str, Any]) -> None:
        super().__init__(reason)
        named = [name for name in values if reason.startswith(name)]
        named += [name for name in values if name in reason]
        self.refused = named[0] if named else None


class Changes:
    """
    Sets parameters of the controller, and takes that back.

    Attributes
    ----------
    undo
        The values of before.
    applied
        What was set last: that change comes back as an event of the controller.

    """

    def __init__(self, monitor: Monitor) -> None:
        self.undo = Undo()
        self.applied: Values = {}
        self._monitor = monitor
        self._changing = asyncio.Lock()

    async def set_all(self, values: Mapping[str, Any]) -> None:
        """
        Set all of these parameters or none, in one request, which can be undone.

        Raises
        ------
        UserError, ValueError
            With the reason of the controller, or for what no parameter can be.

        """
        async with self._changing:
            before = await self._set(values)
            self.undo.note(values, before)

    async def to_previous(self) -> Values:
        """Undo the last change, and return the values that hold again."""
        async with self._changing:
            values = self.undo.previous()
            if not values:
                raise UserError('there is no earlier change of a page')
            await self._set(values)
            self.undo.drop()
        return values

    async def to_start(self) -> Values:
        """Return to the values that the controller had at first; that can be undone too."""
        async with self._changing:
            values = self.undo.since_start(self._now())
            if not values:
                raise UserError('nothing is different from where you began')
            self.undo.note(values, await self._set(values))
        return values

    async def _set(self, values: Mapping[str, Any]) -> Values:
        monitor, before = self._monitor, self._now()
        if monitor.peer is None:
            raise UserError('this server was started with --read-only')
        types = {name: each.type for name, each in monitor.descriptors.items()}
        self.applied = dict(values)
        answer = await answered(monitor.peer, monitor.peer.set_all(values, types))
        if not answer.result.successful:
            raise Refused(str(answer.result.reason), values)
        return before

    def _now(self) -> Values:
        return self._monitor.parameters(self._monitor.controller)


async def answered(peer: Peer, done: Done) -> Any:
    """
    Return the answer of a node.

    Raises
    ------
    UserError
        When it does not come.

    """
    try:
        return await asyncio.wait_for(asyncio.wrap_future(done), _ANSWER)
    except asyncio.TimeoutError:
        raise UserError(f'{peer.name} did not answer within {_ANSWER:g} s') from None

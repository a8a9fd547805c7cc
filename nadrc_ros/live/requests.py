"""What a page may ask for, and who may ask."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from math import isfinite
from typing import Any, TypeGuard

from nadrc_ros.adrc.errors import one_of, UserError
from nadrc_ros.live.outbox import Message
from nadrc_ros.live.peer import Done, Peer
from nadrc_ros.live.session import Client, parsed, Session

# A node answers within so long, or not at all [s]; what stops is asked for again and again.
_ANSWER, _STOP_AGAIN, _STOPS = 3.0, 0.25, 8
# So long a page has to send a fresh beat before what it holds may run [s].
_FIRST_BEAT = 0.5
# Longer ids are none.
_LONGEST_ID = 64
Work = Callable[[Client, Message], Awaitable[Message]]


class Requests:
    """Answers the requests of the pages of a session."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._changing = asyncio.Lock()
        # What any page may ask for, and what needs control.
        self._free: dict[str, Work] = {'take_over': self._take_over}
        self._bound: dict[str, Work] = {
            'apply': self._apply,
            'enable': self._enable,
            'back': self._back,
        }

    def take(self, client: Client, text: str | bytes) -> None:
        """Take a message of a page; nothing in it can raise here."""
        try:
            request = parsed(text)
        except ValueError as error:
            self._answer(client, None, False, f'not a request: {error}')
            return
        what = request['do']
        if what == 'stop':  # before all that could take time
            self._stop(client, request)
        elif what == 'beat':
            self._beat(client, request)
        else:
            self._session.background(self._work(client, what, request))

    async def _work(self, client: Client, what: str, request: Message) -> None:
        known = self._free | self._bound
        if what not in known:
            self._answer(client, request, False, f'no such request: {_or(what, known)}')
        elif what != 'save' and self._session.read_only:
            self._answer(client, request, False, 'this server was started with --read-only')
        elif what in self._bound and client is not self._session.operator:
            self._answer(client, request, False, 'another page has control: take over first')
        else:
            try:
                more = await known[what](client, request)
                self._answer(client, request, True, more.pop('text', ''), more)
            except (UserError, ValueError) as error:
                more = getattr(error, 'more', {})
                self._answer(client, request, False, str(error), more)

    def _answer(
        self,
        client: Client,
        request: Message | None,
        ok: bool,
        text: str,
        more: Mapping[str, Any] = {},
    ) -> None:
        number = None if request is None else request.get('id')
        if not isinstance(number, (int, float, str)) or len(str(number)) > _LONGEST_ID:
            number = None
        client.tell({'type': 'answer', 'id': number, 'ok': ok, 'text': text} | dict(more))

    # ---- running ----

    def _beat(self, client: Client, request: Message) -> None:
        number, sent = request.get('n'), request.get('time')
        if client is not self._session.operator or self._session.read_only:
            return
        if not (_is_finite(number) and _is_finite(sent)):
            return
        client.hold.beat(float(number), 1e-3 * float(sent), request.get('idle') is True)

    def _stop(self, client: Client, request: Message) -> None:
        """Stop the loop for any page, also one that only watches."""
        session = self._session
        if session.read_only:
            self._answer(client, request, False, 'this server was started with --read-only')
            return
        first = session.stop()
        for each in session.clients:
            each.hold.holding = False
        session.background(self._stopped(client, request, first))

    async def _stopped(self, client: Client, request: Message, first: Done) -> None:
        """Ask again until there is an answer, as the first one may have been lost."""
        asked = [asyncio.wrap_future(first)]
        for _ in range(_STOPS):
            done, _ = await asyncio.wait(
                asked, timeout=_STOP_AGAIN, return_when=asyncio.FIRST_COMPLETED
            )
            if done:
                answer = done.pop().result()
                self._answer(client, request, bool(answer.success), str(answer.message))
                return
            asked.append(asyncio.wrap_future(self._session.stop()))
        text = 'the controller does not answer: use the emergency stop of the machine'
        self._answer(client, request, False, text)

    async def _enable(self, client: Client, request: Message) -> Message:
        monitor, hold = self._session.monitor, client.hold
        assert monitor.peer is not None
        if request.get('hold', not monitor.simulated):
            if not monitor.peer.takes_leases:
                raise UserError(
                    'hold to run is not possible: nothing reads the heartbeat on '
                    f'{monitor.controller}/keep'
                )
            end = monitor.now() + _FIRST_BEAT
            while not hold.beats:
                if monitor.now() > end:
                    raise UserError('hold to run needs the heartbeat of the page: none is fresh')
                await asyncio.sleep(0.01)
            hold.begin()
        else:
            hold.holding = False
            monitor.peer.keep(0.0)
        try:
            answer = await answered(monitor.peer, monitor.peer.enable())
        except UserError:
            hold.end()
            raise
        if not answer.success:
            hold.holding = False
            raise UserError(str(answer.message))
        return {'text': str(answer.message)}

    async def _take_over(self, client: Client, request: Message) -> Message:
        self._session.take_over(client)
        return {'text': 'this page has control'}

    # ---- parameters ----

    async def _apply(self, client: Client, request: Message) -> Message:
        values = request.get('values')
        if not (isinstance(values, dict) and values):
            raise ValueError('values: must be an object of parameters')
        await self.set_all(values)
        return {'text': f'{_count(values)} applied'}

    async def _back(self, client: Client, request: Message) -> Message:
        session = self._session
        async with self._changing:
            if request.get('to', 'previous') == 'start':
                now = session.monitor.parameters(session.monitor.controller)
                values = session.undo.since_start(now)
                if not values:
                    raise UserError('nothing is different from where you began')
                await self._set(values)
            else:
                values = session.undo.previous()
                if not values:
                    raise UserError('there is no earlier change of a page')
                await self._set(values, forward=False)
                session.undo.drop()
        return {'text': f'{_count(values)} as before', 'values': values}

    async def set_all(self, values: Mapping[str, Any]) -> None:
        """
        Set parameters of the controller, all or none, in one request, which can be undone.

        Raises
        ------
        UserError
            With the reason of the controller.

        """
        async with self._changing:
            await self._set(values)

    async def _set(self, values: Mapping[str, Any], *, forward: bool = True) -> None:
        session, monitor = self._session, self._session.monitor
        assert monitor.peer is not None
        now = monitor.parameters(monitor.controller)
        types = {name: each.type for name, each in monitor.descriptors.items()}
        session.note_applied(values)
        answer = await answered(monitor.peer, monitor.peer.set_all(values, types))
        if not answer.result.successful:
            raise Refused(str(answer.result.reason), values)
        if forward:
            session.undo.note(values, now)


class Refused(UserError):
    """A controller refused values; ``more`` has the name of the one that its reason names."""

    def __init__(self, reason: str, values: Mapping[str, Any]) -> None:
        super().__init__(reason)
        named = [name for name in values if reason.startswith(name)]
        named += [name for name in values if name in reason]
        self.more = {'refused': named[0] if named else None}


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


def _or(what: str, known: Mapping[str, Any]) -> str:
    return f'{what[:40]}: must be {one_of(what, list(known))}'


def _count(values: Mapping[str, Any]) -> str:
    return '1 parameter' if len(values) == 1 else f'{len(values)} parameters'


def _is_finite(value: Any) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and isfinite(value)

"""What a page may ask for, and who may ask."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any, TypeGuard

from nadrc_ros.adrc.errors import one_of, UserError
from nadrc_ros.live.changes import answered, Refused
from nadrc_ros.live.hello import shown
from nadrc_ros.live.outbox import Message
from nadrc_ros.live.peer import Done, parameter_value
from nadrc_ros.live.plant_faults import PlantFaults
from nadrc_ros.live.prediction import prediction
from nadrc_ros.live.saving import make_report, saved
from nadrc_ros.live.session import Client, parsed, Session

# What stops is asked for again and again [s].
_STOP_AGAIN, _STOPS = 0.5, 6
# So many requests of one page wait at most.
_MOST = 50
# So long a page has to send a fresh beat before what it holds may run [s].
_FIRST_BEAT = 0.5
# What changes nothing, not even on this machine.
_HARMLESS = ('predict', 'save')
# Longer ids are none.
_LONGEST_ID = 64
Work = Callable[[Client, Message], Awaitable[Message]]


class Requests:
    """Answers the requests of the pages of a session."""

    def __init__(self, session: Session, reports: Path) -> None:
        self._session = session
        self._reports = reports
        self._faults = PlantFaults()
        self._newest: dict[Client, Any] = {}  # of what a page wants to have predicted
        # What any page may ask for, and what needs control.
        self._free: dict[str, Work] = {
            'take_over': self._take_over,
            'predict': self._predict,
            'save': self._save,
            'report': self._report,
        }
        self._bound: dict[str, Work] = {
            'apply': self._apply,
            'enable': self._enable,
            'back': self._back,
            'pin': self._pin,
            'unpin': self._unpin,
            'swap': self._swap,
            'guard': self._guard,
            'fault': self._fault,
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
        elif client.waiting >= _MOST:
            self._answer(client, request, False, 'too many requests wait: ask again')
        else:
            client.waiting += 1
            self._session.background(self._work(client, what, request))

    async def _work(self, client: Client, what: str, request: Message) -> None:
        """Work on the requests of a page one by one, but for predictions, of which one counts."""
        try:
            if what == 'predict':
                await self._work_on(client, what, request)
            else:
                async with client.working:
                    await self._work_on(client, what, request)
        finally:
            client.waiting -= 1

    async def _work_on(self, client: Client, what: str, request: Message) -> None:
        known = self._free | self._bound
        if what not in known:
            self._answer(client, request, False, f'no such request: {_or(what, known)}')
        elif what not in _HARMLESS and self._session.read_only:
            self._answer(client, request, False, 'this server was started with --read-only')
        elif what in self._bound and client is not self._session.operator:
            self._answer(client, request, False, 'another page has control: take over first')
        elif what in self._bound and (why := self._session.monitor.commissioned):
            self._answer(client, request, False, f'{why}: a page may only watch, and STOP')
        else:
            try:
                more = await known[what](client, request)
                if more:
                    self._answer(client, request, True, more.pop('text', ''), more)
            except (UserError, ValueError) as error:
                named = {'refused': error.refused} if isinstance(error, Refused) else {}
                self._answer(client, request, False, str(error), named)

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
        await self._session.changes.set_all(values)
        return {'text': f'{_count(values)} applied'}

    async def _back(self, client: Client, request: Message) -> Message:
        changes = self._session.changes
        start = request.get('to') == 'start'
        values = await (changes.to_start() if start else changes.to_previous())
        return {'text': f'{_count(values)} as before', 'values': values}

    # ---- comparing ----

    async def _predict(self, client: Client, request: Message) -> Message:
        """Predict for the newest values that a page asks about; older ones are left out."""
        values = request.get('values')
        if not isinstance(values, dict):
            raise ValueError('values: must be an object of parameters')
        busy = client in self._newest
        self._newest[client] = request
        if busy:
            return {}
        monitor, done = self._session.monitor, None
        try:
            while (newest := self._newest[client]) is not done:
                rate = monitor.parameters(monitor.controller).get('rate')
                found = await asyncio.to_thread(
                    prediction, monitor.controller_settings(), newest['values'], rate
                )
                client.tell(found | {'id': newest.get('id')})
                done = newest
        finally:
            del self._newest[client]
        return {}

    async def _pin(self, client: Client, request: Message) -> Message:
        found = self._session.pinned.pin(request.get('from'), request.get('to'))
        self._session.tell(self._session.pinned.comparison())
        return found

    async def _unpin(self, client: Client, request: Message) -> Message:
        found = self._session.pinned.unpin()
        self._session.tell(self._session.pinned.comparison())
        self._session.tell(self._session.pinned.told_guard())
        return found

    async def _swap(self, client: Client, request: Message) -> Message:
        return await self._session.pinned.swap()

    async def _guard(self, client: Client, request: Message) -> Message:
        told = self._session.pinned.guard(request.get('on') is True)
        self._session.tell(told)
        return {'text': told['text']}

    async def _fault(self, client: Client, request: Message) -> Message:
        monitor, value = self._session.monitor, request.get('value')
        if monitor.plant_peer is None:
            raise UserError('faults are for a simulated plant')
        if value is not None and not _is_finite(value):
            raise ValueError('value: must be a number')
        plant, on = monitor.parameters(monitor.plant), request.get('on') is True
        values = self._faults.values(str(request.get('name')), on, value, plant)
        if values:
            types = {name: parameter_value(plant[name], 0).type for name in values}
            asked = monitor.plant_peer.set_all(values, types)
            answer = await answered(monitor.plant_peer, asked)
            if not answer.result.successful:
                raise Refused(str(answer.result.reason), values)
        return {'text': f'{request["name"]}: {"on" if on else "off"}'}

    # ---- what is taken along ----

    async def _save(self, client: Client, request: Message) -> Message:
        monitor = self._session.monitor
        now = dict(shown(monitor.parameters(monitor.controller)))
        if not now:
            raise UserError('the parameters of the controller are not known')
        before = self._session.changes.undo.since_start(now)
        return await asyncio.to_thread(saved, monitor.controller, now, before)

    async def _report(self, client: Client, request: Message) -> Message:
        monitor = self._session.monitor
        said = monitor.reports.get(monitor.recorder)
        if said is None or not said.values.get('folder'):
            raise UserError(
                f'a report is made of what {monitor.recorder} records: it is not there'
            )
        folder = said.values['folder']
        if not Path(folder).is_dir():
            raise UserError(f'{folder} of {monitor.recorder} is not on this machine or path')
        await answered(monitor.recording, monitor.recording.save())
        return {
            'text': f'report of {folder}',
            'url': f'/report/{await make_report(folder, self._reports)}',
        }


def _or(what: str, known: Mapping[str, Any]) -> str:
    return f'{what[:40]}: must be {one_of(what, list(known))}'


def _count(values: Mapping[str, Any]) -> str:
    return '1 parameter' if len(values) == 1 else f'{len(values)} parameters'


def _is_finite(value: Any) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and isfinite(value)

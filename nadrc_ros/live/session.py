"""What the pages of one loop share: who is there, who has control, what was changed."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
import json
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.blocks import thin, THINNED
from nadrc_ros.live.changes import Changes
from nadrc_ros.live.hello import hello, Rate, shown, state
from nadrc_ros.live.hold import Hold
from nadrc_ros.live.monitor import Monitor
from nadrc_ros.live.outbox import Full, Message, Outbox, Write
from nadrc_ros.live.pinned import Pinned
from nadrc_ros.live.undo import Undo

# So many posts of the node wait for a server that stands still; then the oldest rows are lost.
_POSTS = 400
_STATE, _COMPARED = 0.1, 1.0  # [s]
# At the start a page gets so many seconds of history, of which the last few whole.
_HISTORY, _WHOLE, _BINS = 120.0, 10.0, 2000
_EVENTS = 200
_DIGITS = 19


class Client:
    """One page: its outbox and its heartbeat."""

    def __init__(self, write: Write, close: Callable[[], None], hold: Hold) -> None:
        self.outbox = Outbox(write)
        self.close = close
        self.hold = hold
        self.waiting = 0  # requests
        self.working = asyncio.Lock()
        self.sending: asyncio.Task[None] | None = None

    def tell(self, message: Message) -> None:
        """Send a message; a page that takes none is closed."""
        try:
            self.outbox.tell(message)
        except Full:
            self.close()


class Session:
    """
    The loop that is shown, on the thread of the server.

    Attributes
    ----------
    clients
        The pages that are open, the oldest first.
    operator
        The one that has control.
    changes
        Those that pages made.
    pinned
        What is compared with.
    number
        Of the last change of parameters.

    """

    def __init__(self, monitor: Monitor) -> None:
        self.monitor = monitor
        self.clients: list[Client] = []
        self.operator: Client | None = None
        self.changes = Changes(monitor)
        self.pinned = Pinned(monitor, self.changes.set_all)
        self.number = 0
        self._rate = Rate()
        self._posts: deque[tuple[str, Message]] = deque(maxlen=_POSTS)
        self._events: deque[Message] = deque(maxlen=_EVENTS)
        self._awake = False
        self._signals = monitor.signals
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[Any]] = set()
        self.background(self._tell_state())
        self.background(self._compare())
        monitor.post = self._on_post

    def background(self, work: Any) -> None:
        """Run something for as long as it takes."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Stop a loop that a page holds, and let the pages go."""
        self.monitor.post = lambda kind, content: None
        for task in self._tasks:
            task.cancel()
        for client in list(self.clients):
            client.hold.end()
            client.close()

    # ---- pages ----

    def enter(self, write: Write, close: Callable[[], None]) -> Client:
        """Take a page in; the only one has control."""
        hold = Hold(self.keep, self.stop, self._loop.time)
        client = Client(write, close, hold)
        self.clients.append(client)
        if self.operator is None and len(self.clients) == 1 and not self.read_only:
            self.operator = client
        client.tell(self._hello(client))
        if self.operator is None:
            client.tell({'type': 'operator', 'operator': False, 'text': 'Nobody has control'})
        for event in self._events:
            client.tell(event)
        if self.pinned.stretch is not None:
            client.tell(self.pinned.comparison())
        client.tell(self.pinned.told_guard())
        self._tell_history(client)
        client.tell(state(self.monitor, self._rate) | self._about(client))
        client.sending = self._loop.create_task(client.outbox.run())
        return client

    def leave(self, client: Client) -> None:
        """Let a page go; a loop that it holds is stopped."""
        client.hold.end()
        if client.sending is not None:
            client.sending.cancel()
        if client in self.clients:
            self.clients.remove(client)
        if client is self.operator:
            self.operator = None
            self.tell_operator('Nobody has control: the page that had it was closed')

    def take_over(self, client: Client) -> None:
        """Give control to a page; a loop that the other one holds is stopped."""
        if self.operator is not None and self.operator is not client:
            self.operator.hold.end()
        self.operator = client
        self.tell_operator('Another page has control now')

    def tell_operator(self, text: str) -> None:
        """Tell every page whether it has control."""
        for client in self.clients:
            own = client is self.operator
            client.tell(
                {
                    'type': 'operator',
                    'operator': own,
                    'text': 'this page has control' if own else text,
                }
            )

    def tell(self, message: Message) -> None:
        """Send a message to all pages."""
        if message['type'] == 'event':
            self._events.append(message)
        for client in list(self.clients):
            client.tell(message)

    def event(self, kind: str, text: str) -> None:
        """Tell all pages what this server did."""
        self.tell(
            {'type': 'event', 't': self.monitor.now(), 'node': 'page', 'kind': kind, 'text': text}
        )

    # ---- the controller ----

    @property
    def read_only(self) -> bool:
        """Tell whether nothing can be changed."""
        return self.monitor.peer is None

    def keep(self, seconds: float) -> None:
        """Lease the controller some more time [s], unless that would hold an experiment."""
        if self.monitor.peer is not None and not self.monitor.experiment:
            self.monitor.peer.keep(seconds)

    def stop(self) -> Any:
        """Disable the controller, at once; return what will have the answer."""
        return None if self.monitor.peer is None else self.monitor.peer.stop()

    # ---- what the node posts, from its thread ----

    def _on_post(self, kind: str, content: Message) -> None:
        self._posts.append((kind, content))
        if not self._awake:
            self._awake = True
            with suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._take_posts)

    def _take_posts(self) -> None:
        self._awake = False
        while self._posts:
            kind, content = self._posts.popleft()
            getattr(self, f'_take_{kind}')(content)

    def _take_rows(self, content: Message) -> None:
        for client in self.clients:
            client.outbox.add(content['rows'], content['flags'])
        if self.monitor.commissioned:
            return
        if why := self.pinned.trouble(content['rows']):
            self.background(self._go_back(why))

    def _take_event(self, content: Message) -> None:
        self.tell({'type': 'event'} | content)

    def _take_state(self, content: Message) -> None:
        for client in list(self.clients):
            client.tell(state(self.monitor, self._rate) | self._about(client))

    def _take_changed(self, content: Message) -> None:
        if content.get('anew'):
            self._begin_anew()
        if values := self.monitor.parameters(self.monitor.controller):
            self.changes.undo.begin(values)
        others, self._signals = self._signals != self.monitor.signals, self.monitor.signals
        for client in list(self.clients):
            if others:
                client.outbox.forget_blocks()
            client.tell(self._hello(client))
            if others:
                self._tell_history(client)

    def _take_parameters(self, content: Message) -> None:
        node, values = content['node'], content['values']
        if node != self.monitor.controller:
            text = ', '.join(f'{name} = {value}' for name, value in values.items())
            self._take_event({'t': content['t'], 'node': node, 'kind': 'parameters', 'text': text})
            if node == self.monitor.plant:
                self._take_changed({})
            return
        values = dict(shown(values))
        if not values:
            return
        self.number += 1
        before = {name: value for name, value in content['before'].items() if name in values}
        self.pinned.note_change(content['t'], before)
        ours = all(self.changes.applied.get(name) == value for name, value in values.items())
        self.tell(
            {
                'type': 'parameters',
                'values': values,
                'before': before,
                'source': 'page' if ours else node,
                't': content['t'],
                'number': self.number,
            }
        )

    def _begin_anew(self) -> None:
        """Forget the values of before: they are of another process."""
        self.changes.undo = Undo()
        self.pinned.unpin()
        self.pinned.note_change(self.monitor.now(), {})
        self.tell(self.pinned.comparison())
        self.tell(self.pinned.told_guard())
        text = 'the controller was started with other parameters: nothing is pinned or pending'
        self.event('started', text)

    # ---- what pages are told ----

    def _hello(self, client: Client) -> Message:
        return hello(self.monitor) | {'operator': client is self.operator}

    def _about(self, client: Client) -> Message:
        lease = None if self.operator is None else self.operator.hold.left
        return {
            'lease': lease,
            'holding': lease is not None,
            'operator': client is self.operator,
            'clients': len(self.clients),
        }

    def _tell_history(self, client: Client) -> None:
        ring = self.monitor.ring
        last = ring.last
        old = ring.between(last - _HISTORY, last - _WHOLE)
        if len(old):
            thinned = thin(old, _BINS)
            client.outbox.add(thinned, THINNED if len(thinned) < len(old) else 0)
        new = ring.between(max(last - _WHOLE, old[-1, 0] + 1e-9 if len(old) else 0.0), last)
        if len(new):
            thinned = thin(new, _BINS)
            client.outbox.add(thinned, THINNED if len(thinned) < len(new) else 0)

    async def _go_back(self, why: str) -> None:
        """Go back to the pinned parameters, and say why."""
        try:
            await self.pinned.restore()
            self.event('guard', f'{why}: back to the pinned parameters')
        except UserError as error:
            self.event('guard', f'{why}, but not back to the pinned parameters: {error}')
        self.tell(self.pinned.told_guard())

    async def _compare(self) -> None:
        told: Message = {}
        while True:
            await asyncio.sleep(_COMPARED)
            if self.pinned.stretch is None or not self.clients:
                continue
            found = await asyncio.to_thread(self.pinned.comparison)
            if found != told:
                told = found
                self.tell(found)

    async def _tell_state(self) -> None:
        while True:
            await asyncio.sleep(_STATE)
            if self.operator is not None and self.operator.hold.look():
                self.event('hold', 'the heartbeat of the page stopped: disabled')
            self._take_state({})


def parsed(text: str | bytes) -> Message:
    """
    Return a request of a page.

    Raises
    ------
    ValueError
        For what is none.

    """
    try:
        found = json.loads(text, parse_constant=partial(_refuse, 'not a number'), parse_int=_whole)
    except (RecursionError, UnicodeDecodeError):
        raise ValueError('not JSON') from None
    if not isinstance(found, dict) or not isinstance(found.get('do'), str):
        raise ValueError('not an object with "do"')
    return found


def _whole(digits: str) -> int:
    if len(digits) > _DIGITS:  # no parameter and no float could have it
        raise ValueError('a number of too many digits')
    return int(digits)


def _refuse(why: str, what: str) -> None:
    raise ValueError(f'{what}: {why}')

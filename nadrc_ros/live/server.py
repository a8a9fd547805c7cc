"""The web server of a page: its files, and the websocket; nothing changes by a GET."""

from __future__ import annotations

from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from nadrc_ros.live.access import Access
from nadrc_ros.live.figures import plots
from nadrc_ros.live.requests import Requests
from nadrc_ros.live.session import Client, Session
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

# A larger message closes the socket of who sent it [bytes].
LARGEST = 65536
_NAME = r'[A-Za-z0-9_][A-Za-z0-9_.-]*'
_TYPES = {
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript; charset=utf-8',
    '.css': 'text/css; charset=utf-8',
    '.svg': 'image/svg+xml',
    '.png': 'image/png',
}


class _Guarded(RequestHandler):
    """Refuses what does not come from a page of this server."""

    access: Access
    is_report = False

    def initialize(self, access: Access, **more: Any) -> None:
        """Take what the application passes."""
        self.access = access
        for name, value in more.items():
            setattr(self, name, value)

    def set_default_headers(self) -> None:
        """Set the headers of every answer, errors included."""
        self.clear_header('Server')

    def prepare(self) -> None:
        """Refuse before anything else is done."""
        host = self.request.headers.get('Host', '')
        status = 403
        refusal = self.access.refusal(self.request.headers, socket=self._is_socket)
        for name, value in self.access.headers(
            '' if refusal else host, report=self.is_report
        ).items():
            self.set_header(name, value)
        if not (refusal or self._is_admitted()):
            refusal = 'open the address that `nadrc live` printed: this one has no token'
        if not refusal and self.request.method not in ('GET', 'HEAD'):
            self.set_header('Allow', 'GET, HEAD')
            refusal, status = 'only GET', 405
        if refusal:
            self.set_status(status)
            self.set_header('Content-Type', 'text/plain; charset=utf-8')
            self.finish(refusal + '\n')

    _is_socket = False

    def _is_admitted(self) -> bool:
        return self.access.knows(self.request.headers)

    def send_file(self, path: Path | Any) -> None:
        """Send a file, or that there is none."""
        kind = _TYPES.get(Path(str(path)).suffix)
        if kind is None or not path.is_file():
            self.set_status(404)
            self.finish('there is no such file\n')
            return
        self.set_header('Content-Type', kind)
        self.finish(path.read_bytes())

    def head(self, *arguments: str) -> Any:
        """Answer as GET does; Tornado leaves the body out."""
        return self.get(*arguments)


class _Page(_Guarded):
    """The page; with a token, the cookie for it."""

    @property
    def _token(self) -> str:
        given = self.request.query_arguments.get('token', [b''])[-1]
        return given.decode(errors='replace')

    def _is_admitted(self) -> bool:
        return super()._is_admitted() or self.access.admits(self._token)

    def get(self) -> None:
        """Send the page, or the way to it without the token."""
        if not self._token:
            self.send_file(files('nadrc_ros.live') / 'static' / 'index.html')
            return
        if self.access.admits(self._token):
            name, value = self.access.cookie_name, self.access.cookie
            self.set_header('Set-Cookie', f'{name}={value}; HttpOnly; SameSite=Strict; Path=/')
        self.redirect('/', status=303)


class _Static(_Guarded):
    """The other files of the page, and BokehJS as the package has it."""

    folder: Any

    def get(self, name: str) -> None:
        """Send a file."""
        self.send_file(self.folder / name)


class _Report(_Static):
    """A report, which has scripts of its own in it."""

    is_report = True


class _Text(_Guarded):
    """A text that stays the same for the life of the server."""

    text: str

    def get(self) -> None:
        """Send it."""
        self.set_header('Content-Type', 'application/json')
        self.finish(self.text)


class _Nothing(_Guarded):
    """What there is not."""

    def get(self) -> None:
        """Say so."""
        self.set_status(404)
        self.finish('there is no such page\n')


class _Socket(WebSocketHandler, _Guarded):
    """The connection of a page."""

    session: Session
    requests: Requests
    _client: Client | None = None
    _is_socket = True

    def check_origin(self, origin: str) -> bool:
        """Leave it to what every request has to pass."""
        return True

    def open(self, *arguments: str) -> None:
        """Take the page in."""
        self._client = self.session.enter(self._write, self._hang_up)

    def on_message(self, message: str | bytes) -> None:
        """Take a request."""
        if self._client is not None:
            self.requests.take(self._client, message)

    def on_close(self) -> None:
        """Let the page go."""
        if self._client is not None:
            self.session.leave(self._client)

    async def _write(self, message: str | bytes) -> None:
        try:
            await self.write_message(message, binary=isinstance(message, bytes))
        except WebSocketClosedError:
            self._hang_up()

    def _hang_up(self) -> None:
        self.close(1008, 'too slow')


def application(access: Access, session: Session, reports: Path) -> Application:
    """Return the web application of a loop."""
    bokeh = find_spec('bokeh')
    assert bokeh is not None and bokeh.submodule_search_locations is not None
    scripts = Path(bokeh.submodule_search_locations[0], 'server', 'static', 'js')
    known = {'access': access}
    return Application(
        [
            (r'/', _Page, known),
            (
                rf'/static/({_NAME})',
                _Static,
                known | {'folder': files('nadrc_ros.live') / 'static'},
            ),
            (rf'/static/bokeh/({_NAME}\.min\.js)', _Static, known | {'folder': scripts}),
            (r'/plots\.json', _Text, known | {'text': plots()}),
            (rf'/report/({_NAME}\.html)', _Report, known | {'folder': reports}),
            (
                r'/ws',
                _Socket,
                known | {'session': session, 'requests': Requests(session, reports)},
            ),
        ],
        default_handler_class=_Nothing,
        default_handler_args=known,
        websocket_max_message_size=LARGEST,
        websocket_ping_interval=2.0,
        websocket_ping_timeout=2.0,
        log_function=lambda handler: None,
    )

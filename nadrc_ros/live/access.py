"""Who may talk to the page's server: the holder of the token, in a page of this very server."""

from __future__ import annotations

from collections.abc import Mapping
from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
import secrets
import socket

import attrs

_LOCAL = ('127.0.0.1', 'localhost', '[::1]')
_EVERYWHERE = ('0.0.0.0', '::', '')
# Where a page of this server is loaded from: itself. BokehJS makes elements <style>.
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws://{host}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# A report brings its scripts along, and runs them in an origin of its own without a network.
_REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


@attrs.frozen
class Access:
    """
    What a request must bring: a known Host, no foreign Origin, and the cookie that a token gives.

    Pages of other sites can send requests to 127.0.0.1 and, by a name of theirs that leads there,
    even read the answers: neither comes with our Host and the cookie of a strict SameSite.

    Parameters
    ----------
    port
        Of the server.
    host
        The address it listens at.

    """

    port: int
    host: str = '127.0.0.1'
    token: str = attrs.field(factory=lambda: secrets.token_urlsafe(24))
    cookie: str = attrs.field(factory=lambda: secrets.token_urlsafe(24))

    @property
    def cookie_name(self) -> str:
        """Return the name of the cookie: browsers keep those of one host together."""
        return f'nadrc_live_{self.port}'

    @property
    def address(self) -> str:
        """Return the address to open."""
        host = socket.gethostname() if self.host in _EVERYWHERE else self.host
        return f'http://{_bracketed(host)}:{self.port}/?token={self.token}'

    def refusal(self, headers: Mapping[str, str], *, socket: bool = False) -> str:
        """Return why a request is refused whoever sent it, '' if it is not."""
        host = headers.get('Host', '')
        if not self._is_ours(host):
            return f'unknown Host: {host[:80]}'
        origin = headers.get('Origin')
        if origin is None:
            return 'a websocket needs an Origin' if socket else ''
        return '' if origin == f'http://{host}' else f'foreign Origin: {origin[:80]}'

    def knows(self, headers: Mapping[str, str]) -> bool:
        """Tell whether a request has the cookie."""
        try:
            found = SimpleCookie(headers.get('Cookie', '')).get(self.cookie_name)
        except CookieError:
            return False
        return found is not None and _same(found.value, self.cookie)

    def admits(self, token: str) -> bool:
        """Tell whether that is the token."""
        return _same(token, self.token)

    def headers(self, host: str, *, report: bool = False) -> dict[str, str]:
        """Return the headers of every answer."""
        policy = _REPORT_POLICY if report else _POLICY.format(host=host)
        return {
            'Content-Security-Policy': policy,
            'X-Content-Type-Options': 'nosniff',
            'X-Frame-Options': 'DENY',
            'Referrer-Policy': 'no-referrer',
            'Cross-Origin-Resource-Policy': 'same-origin',
            'Cross-Origin-Opener-Policy': 'same-origin',
            'Cache-Control': 'no-store',
        }

    def _is_ours(self, host: str) -> bool:
        name, _, port = host.rpartition(':')
        if port != str(self.port):
            return False
        if name in _LOCAL or (name and name == _bracketed(self.host)):
            return True
        if self.host not in _EVERYWHERE:
            return False
        if name == socket.gethostname():
            return True
        try:  # no name that another's name server could lead here
            ip_address(name.strip('[]'))
        except ValueError:
            return False
        return True


def _bracketed(host: str) -> str:
    return f'[{host}]' if ':' in host else host


def _same(one: str, two: str) -> bool:
    return compare_digest(one.encode(), two.encode())

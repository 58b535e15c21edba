"""Who may talk to the server: pages of its own only, by names of its own only, with the token where there is one."""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import re
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PAGE = "/"
LOOPBACK = ("localhost", "127.0.0.1", "::1")
REFUSED = 4403  # WebSockets close with numbers of their own
WITHOUT_TOKEN = "this server asks for the token in the link that it printed when it started"
HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::(\d{1,5}))?", re.I)
OWN_SITES = ("same-origin", "none")
"""What browsers say of requests by our own pages, and of addresses that were typed."""


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine alone.

    >>> [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "192.168.1.7")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Guard:
    """Refuses requests under a foreign name, from a foreign page or without the token; adds safe headers.

    A name that leads to this machine without being one of ``hosts`` is how pages of others reach servers at
    home (DNS rebinding). With a ``token`` any name will do. The link that holds it is answered by a cookie and the
    same address without it, so that it stays out of histories, screenshots and links that are passed on.

    With ``for_programs`` the token is also a password: with any name of a user (Basic), as players of video send it
    once they are asked, or as a Bearer's.
    """

    def __init__(
        self, app: ASGIApp, hosts: Iterable[str], token: str | None, policy: str, for_programs: bool = False
    ) -> None:
        self.app, self.token, self.for_programs = app, token, for_programs
        self.hosts = {h.lower() for h in (*LOOPBACK, *hosts)}
        self.headers = [
            (b"content-security-policy", policy.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
        ]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        reason = self._reason(scope, _headers(scope))
        if reason is not None:
            await _refuse(reason, scope, receive, send, self.for_programs and reason == WITHOUT_TOKEN)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = message.get("headers", [])
                extra = list(self.headers)
                if not any(name == b"cache-control" for name, _ in given):
                    extra.append((b"cache-control", b"no-store"))
                message["headers"] = [*given, *extra]
            await send(message)

        is_link = self.token is not None and scope["type"] == "http" and scope["path"] == PAGE and _query_token(scope)
        await (self._without_token if is_link else self.app)(scope, receive, with_headers)

    async def _without_token(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Keep the token in a cookie and lead to the same address without it."""
        rest = urlencode([(k, v) for k, v in _query(scope) if k != "token"])
        answer = RedirectResponse(f"{PAGE}?{rest}" if rest else PAGE, status_code=303)
        assert self.token is not None
        # lax: a link in a mail leads here from another site, and what the page asks for is guarded by its origin
        answer.set_cookie(_cookie_name(_headers(scope).get("host", "")), self.token, httponly=True, samesite="lax")
        await answer(scope, receive, send)

    def _reason(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Why a request is refused; None where it is not."""
        host = headers.get("host", "")
        name = _name_of(host)
        if not name or (self.token is None and name not in self.hosts):
            return f"this server does not answer to the name {host!r}"
        origin = headers.get("origin")
        if origin is not None and origin.lower() != f"{_scheme(scope)}://{host.lower()}":
            return f"pages of {origin} may not use this server"
        is_link = scope["path"] == PAGE and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in OWN_SITES and not is_link:
            return "pages of other sites may not use this server"
        if self.token is not None and scope["path"] != "/health":
            given = _query_token(scope) or _cookie_token(headers)
            if given is None and self.for_programs:
                given = _password(headers)
            if given is None or not hmac.compare_digest(given.encode(), self.token.encode()):
                return WITHOUT_TOKEN
        return None


def policy_of(page: str) -> str:
    """The content security policy of a page with scripts and styles inside: these, and scripts of the server.

    >>> policy_of("<style>p{}</style><script>1</script>").split("; ")[0]
    "default-src 'none'"
    """
    scripts, styles = (
        " ".join(f"'sha256-{_digest(text)}'" for text in re.findall(rf"<{tag}\b[^>]*>(.*?)</{tag}>", page, re.S))
        for tag in ("script", "style")
    )
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src 'self' {scripts}",
            f"style-src {styles}",
            "img-src 'self' blob: data:",
            "media-src 'self' blob: mediastream:",
            "connect-src 'self' blob: data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _name_of(host: str) -> str:
    """The name in a Host header, without its port; nothing of what is no such header, as one with a user's name."""
    found = HOST.fullmatch(host)
    return found[1].strip("[]").lower() if found else ""


def _scheme(scope: Scope) -> str:
    """Of the page that a request belongs to; a proxy that is trusted may have said that it was https."""
    scheme: str = scope["scheme"]
    return {"ws": "http", "wss": "https"}.get(scheme, scheme)


def _headers(scope: Scope) -> dict[str, str]:
    return {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}


def _query(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)


def _query_token(scope: Scope) -> str | None:
    found: dict[str, str] = dict(_query(scope))
    return found.get("token")


def _cookie_name(host: str) -> str:
    """Of the port, since browsers give a cookie to all servers of a machine.

    >>> _cookie_name("192.168.1.7:8080"), _cookie_name("door")
    ('omnimirror-token-8080', 'omnimirror-token-80')
    """
    found = HOST.fullmatch(host)
    return f"omnimirror-token-{found[2] or 80 if found else 80}"


def _cookie_token(headers: dict[str, str]) -> str | None:
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(_cookie_name(headers.get("host", "")))
    except CookieError:
        return None
    return cookie.value if cookie else None


def _password(headers: dict[str, str]) -> str | None:
    """What a program sends as a user's password, or as a token of its own.

    >>> _password({"authorization": "Basic bWU6c2VjcmV0"}), _password({"authorization": "Bearer secret"}), _password({})
    ('secret', 'secret', None)
    """
    kind, _, given = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return given.strip()
    if kind.lower() != "basic":
        return None
    try:
        return base64.b64decode(given, validate=True).decode("utf-8").partition(":")[2]
    except ValueError:
        return None


async def _refuse(reason: str, scope: Scope, receive: Receive, send: Send, is_asking: bool) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": REFUSED, "reason": reason})
        return
    asking = {"www-authenticate": 'Basic realm="omnimirror"'}
    answer = JSONResponse({"detail": reason}, 401, asking) if is_asking else JSONResponse({"detail": reason}, 403)
    await answer(scope, receive, send)

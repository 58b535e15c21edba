"""Who may talk to the server: pages of its own only, by names of its own only, with the token where there is one."""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import re
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "omnimirror-token"
LOOPBACK = ("localhost", "127.0.0.1", "::1")
REFUSED = 4403  # WebSockets close with numbers of their own


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
    home (DNS rebinding). With a ``token``, whose link sets a cookie once, any name will do.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str], token: str | None, policy: str) -> None:
        self.app, self.token = app, token
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
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        reason = self._reason(scope, headers)
        if reason is not None:
            await _refuse(reason, scope, receive, send)
            return
        given = _query_token(scope)

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = list(self.headers)
                if self.token is not None and given is not None:
                    cookie = f"{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"
                    extra.append((b"set-cookie", cookie.encode()))
                message["headers"] = [*message.get("headers", []), *extra]
            await send(message)

        await self.app(scope, receive, with_headers)

    def _reason(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Why a request is refused; None where it is not."""
        host = headers.get("host", "")
        if self.token is None and _name_of(host) not in self.hosts:
            return f"this server does not answer to the name {host!r}"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"pages of {origin} may not use this server"
        if self.token is not None and scope["path"] != "/health":
            given = _query_token(scope) or _cookie_token(headers.get("cookie", ""))
            if given is None or not hmac.compare_digest(given.encode(), self.token.encode()):
                return "this server asks for the token in the link that it printed when it started"
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
    """The name in a Host header, without its port."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def _query_token(scope: Scope) -> str | None:
    found = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token")
    return found[0] if found else None


def _cookie_token(header: str) -> str | None:
    try:
        cookie = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return None
    return cookie.value if cookie else None


async def _refuse(reason: str, scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": REFUSED, "reason": reason})
        return
    await JSONResponse({"detail": reason}, status_code=403)(scope, receive, send)

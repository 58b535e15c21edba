"""Access control: host names, origins and tokens of requests, and security headers of responses."""

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
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
FORBIDDEN_CLOSE_CODE = 4403
"""Close code of rejected WebSockets (application range of RFC 6455)."""
TOKEN_REQUIRED = "a token is required; it is part of the link that the server printed at start"
HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::(\d{1,5}))?", re.I)
OWN_SITES = ("same-origin", "none")
"""Values of Sec-Fetch-Site for requests of pages of this server and for typed addresses."""


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable only from this machine.

    >>> [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "192.168.1.7")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class AccessGuard:
    """ASGI middleware that rejects foreign hosts, foreign origins and requests without the token.

    A host name outside ``hosts`` that resolves to this machine indicates DNS rebinding. With a
    ``token``, all host names are accepted. A link with the token is answered with a cookie and a
    redirect to the same address without it, which keeps the token out of the browser history.

    Parameters
    ----------
    app
        Application to protect.
    hosts
        Accepted host names besides those of the loopback interface.
    token
        Access token; None for no token.
    policy
        Content security policy of the responses.
    accept_passwords
        Also accept the token as the password of any user (Basic) or as a Bearer token, for video
        players and other programs.
    """

    def __init__(
        self,
        app: ASGIApp,
        hosts: Iterable[str],
        token: str | None,
        policy: str,
        accept_passwords: bool = False,
    ) -> None:
        self.app, self.token, self.accept_passwords = app, token, accept_passwords
        self.hosts = {h.lower() for h in (*LOOPBACK_NAMES, *hosts)}
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
        reason = self._refusal(scope, _headers(scope))
        if reason is not None:
            challenge = self.accept_passwords and reason == TOKEN_REQUIRED
            await _refuse(reason, scope, receive, send, challenge)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = message.get("headers", [])
                extra = list(self.headers)
                if not any(name == b"cache-control" for name, _ in headers):
                    extra.append((b"cache-control", b"no-store"))
                message["headers"] = [*headers, *extra]
            await send(message)

        is_page = scope["type"] == "http" and scope["path"] == PAGE
        is_token_link = self.token is not None and is_page and _query_token(scope)
        app = self._redirect_without_token if is_token_link else self.app
        await app(scope, receive, send_with_headers)

    async def _redirect_without_token(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Store the token in a cookie and redirect to the same address without it."""
        rest = urlencode([(k, v) for k, v in _query(scope) if k != "token"])
        response = RedirectResponse(f"{PAGE}?{rest}" if rest else PAGE, status_code=303)
        assert self.token is not None
        name = _cookie_name(_headers(scope).get("host", ""))
        # SameSite=lax admits links from other sites; requests of the page are checked by origin.
        response.set_cookie(name, self.token, httponly=True, samesite="lax")
        await response(scope, receive, send)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Return the reason for refusing a request; None to accept it."""
        host = headers.get("host", "")
        name = _host_name(host)
        if not name or (self.token is None and name not in self.hosts):
            return f"the host name must be one of this server; got {host!r}"
        origin = headers.get("origin")
        if origin is not None and origin.lower() != f"{_scheme(scope)}://{host.lower()}":
            return f"the origin must be this server; got {origin}"
        is_link = scope["path"] == PAGE and headers.get("sec-fetch-mode") == "navigate"
        if headers.get("sec-fetch-site", "none") not in OWN_SITES and not is_link:
            return "requests from pages of other sites are refused"
        if self.token is not None and scope["path"] != "/health":
            token = _query_token(scope) or _cookie_token(headers)
            if token is None and self.accept_passwords:
                token = _authorization_token(headers)
            if token is None or not hmac.compare_digest(token.encode(), self.token.encode()):
                return TOKEN_REQUIRED
        return None


def content_security_policy(page: str) -> str:
    """Return the policy for an HTML page: its inline scripts and styles, and scripts of the server.

    >>> policy = content_security_policy("<style>p{}</style><script>1</script>")
    >>> policy.split("; ")[0]
    "default-src 'none'"
    """
    scripts, styles = (
        " ".join(
            f"'sha256-{_digest(text)}'"
            for text in re.findall(rf"<{tag}\b[^>]*>(.*?)</{tag}>", page, re.S)
        )
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


def _host_name(host: str) -> str:
    """Return the name in a Host header without its port; empty for an invalid header."""
    match = HOST.fullmatch(host)
    return match[1].strip("[]").lower() if match else ""


def _scheme(scope: Scope) -> str:
    """Return the scheme of the page of a request; a trusted proxy can have set it to https."""
    scheme: str = scope["scheme"]
    return {"ws": "http", "wss": "https"}.get(scheme, scheme)


def _headers(scope: Scope) -> dict[str, str]:
    return {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}


def _query(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True)


def _query_token(scope: Scope) -> str | None:
    query: dict[str, str] = dict(_query(scope))
    return query.get("token")


def _cookie_name(host: str) -> str:
    """Return the cookie name of a port; browsers send cookies to all ports of a host.

    >>> _cookie_name("192.168.1.7:8080"), _cookie_name("door")
    ('omnimirror-token-8080', 'omnimirror-token-80')
    """
    match = HOST.fullmatch(host)
    port = match[2] if match else None
    return f"omnimirror-token-{port or 80}"


def _cookie_token(headers: dict[str, str]) -> str | None:
    try:
        cookies = SimpleCookie(headers.get("cookie", ""))
    except CookieError:
        return None
    cookie = cookies.get(_cookie_name(headers.get("host", "")))
    return cookie.value if cookie else None


def _authorization_token(headers: dict[str, str]) -> str | None:
    """Return the password (Basic) or token (Bearer) of an Authorization header.

    >>> [_authorization_token({"authorization": value}) for value in ("Basic bWU6c2VjcmV0",
    ...  "Bearer secret", "")]
    ['secret', 'secret', None]
    """
    scheme, _, credentials = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return credentials.strip()
    if scheme.lower() != "basic":
        return None
    try:
        return base64.b64decode(credentials, validate=True).decode("utf-8").partition(":")[2]
    except ValueError:
        return None


async def _refuse(reason: str, scope: Scope, receive: Receive, send: Send, challenge: bool) -> None:
    """Reject a request; with ``challenge``, clients are prompted for a password (401)."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": FORBIDDEN_CLOSE_CODE, "reason": reason})
        return
    if challenge:
        headers = {"www-authenticate": 'Basic realm="omnimirror"'}
        response = JSONResponse({"detail": reason}, 401, headers)
    else:
        response = JSONResponse({"detail": reason}, 403)
    await response(scope, receive, send)

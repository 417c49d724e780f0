# SPDX-License-Identifier: Apache-2.0
"""The server of a live page, in a thread of its own (aiohttp, the extra `live`).

It listens on 127.0.0.1 only. A request is refused unless it has all of these:

- the token, which is in the address that is printed: other users of this machine do not know it;
- a Host header that names this machine itself: a page elsewhere whose name was bound to 127.0.0.1 (DNS rebinding) has
  its own name there;
- no Origin header, or the page's own: browsers send it with what another page asks for.

GET / is the page, GET /data its WebSocket, and POST /command takes {"do": "hold" | "resume" | "stop"} or
{"do": "override", "percent": 0.1 to 120}.
"""

from __future__ import annotations

import asyncio
import hmac
import re
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from aiohttp import WSCloseCode, web

from kontur.errors import BusError
from kontur.live.view import OVERRIDE_MAX, OVERRIDE_MIN, WATCHED_S, View, Viewer

ADDRESS = "127.0.0.1"
_HOST = re.compile(r"(127\.0\.0\.1|localhost)(:\d+)?")
_PAGE = Path(__file__).with_name("page.html")
_VIEWERS_MAX = 8
_SEND_TIMEOUT_S = 5.0  # after that a viewer that takes nothing is left
_CLOSE_S = 2.0
_REQUEST_MAX = 4096  # bytes

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class _Server:
    def __init__(self, view: View, token: str) -> None:
        self._view, self._token = view, token.encode()
        self._viewers = 0
        self.closing = asyncio.Event()

        @web.middleware
        async def guard(request: web.Request, handler: _Handler) -> web.StreamResponse:
            self._check(request)
            return await handler(request)

        self.app = web.Application(middlewares=[guard], client_max_size=_REQUEST_MAX)
        self.app.router.add_get("/", self._page)
        self.app.router.add_get("/data", self._data)
        self.app.router.add_post("/command", self._command)

    def _check(self, request: web.Request) -> None:
        """Refuse what does not come from the page, or from somebody who has its address."""
        host = request.headers.getall("Host", [])
        if len(host) != 1 or not _HOST.fullmatch(host[0]):
            raise web.HTTPForbidden(text="refused: the Host header must name 127.0.0.1 or localhost\n")
        if request.headers.getall("Origin", [f"http://{host[0]}"]) != [f"http://{host[0]}"]:
            raise web.HTTPForbidden(text="refused: the request comes from another page (Origin)\n")
        if not hmac.compare_digest(request.query.get("token", "").encode(), self._token):
            raise web.HTTPForbidden(text="refused: the token is missing or wrong; use the address that was printed\n")

    async def _page(self, request: web.Request) -> web.Response:
        nonce = secrets.token_urlsafe(16)
        policy = (
            f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; "
            "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        headers = {
            "Content-Security-Policy": policy,
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }
        return web.Response(
            text=_PAGE.read_text("utf-8").replace("NONCE", nonce), content_type="text/html", headers=headers
        )

    async def _data(self, request: web.Request) -> web.StreamResponse:
        if self._viewers >= _VIEWERS_MAX:
            raise web.HTTPServiceUnavailable(text=f"{_VIEWERS_MAX} pages are open already; close one\n")
        answer = web.WebSocketResponse(heartbeat=_SEND_TIMEOUT_S, max_msg_size=_REQUEST_MAX, compress=False)
        await answer.prepare(request)
        self._viewers += 1
        self._view.opened.set()
        listening = asyncio.create_task(_ignore(answer))  # this notices that the page has gone
        try:
            await self._tell(answer)
        except (ConnectionError, asyncio.TimeoutError):
            pass
        finally:
            self._viewers -= 1
            listening.cancel()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(answer.close(code=WSCloseCode.OK), _SEND_TIMEOUT_S)
        return answer

    async def _tell(self, answer: web.WebSocketResponse) -> None:
        viewer = Viewer()
        while not answer.closed:
            last = self.closing.is_set()
            for message in self._view.news(viewer):
                await asyncio.wait_for(answer.send_str(message), _SEND_TIMEOUT_S)
            if last:
                return
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self.closing.wait(), WATCHED_S / 2)

    async def _command(self, request: web.Request) -> web.Response:
        try:
            asked = await request.json()
            do, percent = asked["do"], float(asked.get("percent", 100.0))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise web.HTTPBadRequest(text='a command is JSON like {"do": "hold"}\n') from None
        panel = self._view.panel
        if do not in panel.offers:
            offers = ", ".join(panel.offers) or "no command"
            raise web.HTTPConflict(text=f"what runs now takes {offers}\n")
        if do == "stop":
            panel.stop = True
        elif do == "override":
            if not OVERRIDE_MIN <= percent <= OVERRIDE_MAX:
                raise web.HTTPBadRequest(text=f"percent must be {OVERRIDE_MIN:g} to {OVERRIDE_MAX:g}\n")
            panel.percent = percent
        else:
            panel.held = do == "hold"
        return web.json_response({"held": panel.held, "percent": panel.percent, "stop": panel.stop})


async def _ignore(answer: web.WebSocketResponse) -> None:
    async for _ in answer:
        pass


@contextmanager
def serving(view: View, port: int = 0) -> Iterator[str]:
    """Serve the page of `view` on `port` (0: a free one) of 127.0.0.1; yields its address, with the token.

    Raises BusError when the port is taken. At the end the viewers get what they lack, within some seconds.
    """
    token = secrets.token_urlsafe(24)
    try:
        listener = socket.create_server((ADDRESS, port))
    except OSError as error:
        raise BusError(f"port {port} of {ADDRESS} cannot be used for the live page ({error.strerror}); name another "
                       "one, or none") from error  # fmt: skip
    loop = asyncio.new_event_loop()
    server = _Server(view, token)

    async def serve() -> None:
        runner = web.AppRunner(server.app, access_log=None, handle_signals=False, shutdown_timeout=_CLOSE_S)
        await runner.setup()
        await web.SockSite(runner, listener).start()
        await server.closing.wait()
        await runner.cleanup()

    def work() -> None:
        asyncio.set_event_loop(loop)
        loop.run_until_complete(serve())

    thread = threading.Thread(target=work, name="live page", daemon=True)
    thread.start()
    try:
        yield f"http://{ADDRESS}:{listener.getsockname()[1]}/?token={token}"
    finally:
        loop.call_soon_threadsafe(server.closing.set)
        thread.join(2 * _CLOSE_S)

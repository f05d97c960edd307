"""Who comes from elsewhere needs the token, and no other page acts for who has it."""

from __future__ import annotations

import re
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import pytest
from live_service import LiveService, live_motion

FORBIDDEN = re.compile(r"status of 403|WebSocket connection to .* failed|Cross-Origin-Resource-Policy|CORS policy")
"""Chromium writes each refusal in the console, whatever the page does with it."""


@pytest.fixture(scope="module")
def guarded():
    with LiveService(live_motion(), listen="0.0.0.0:0", token_file="") as service:
        yield service


@pytest.fixture
def token(guarded):
    return next(word for text in guarded.said for word in re.findall(r"#token=(\S+)", text))


@pytest.fixture
def url(guarded):
    return f"http://127.0.0.1:{guarded.service.outputs.page.port}/"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_args):
        pass


@pytest.fixture
def elsewhere(tmp_path):
    """Another page on this machine, at another port: another origin, though the same site."""
    (tmp_path / "index.html").write_text("<!doctype html><title>another page</title>")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path))) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


def test_who_comes_from_elsewhere_is_asked_for_the_token_and_told_when_it_is_wrong(url, token, look):
    page = look(url, allowed=FORBIDDEN).page
    assert page.query_selector("#board") is None
    assert page.evaluate("document.activeElement.id") == "token"
    page.keyboard.type("not the token, though long enough")
    page.keyboard.press("Enter")
    page.wait_for_selector("#login-says:not(:empty)")
    assert page.inner_text("#login-says").strip() == "That is not the token."
    page.fill("#token", token)
    page.keyboard.press("Enter")
    page.wait_for_selector("#board[data-drawn]", timeout=60_000)
    assert page.evaluate("document.cookie") == ""
    page.reload()
    page.wait_for_selector("#board[data-drawn]", timeout=60_000)


@pytest.mark.slow
def test_the_printed_address_lets_in_and_the_token_leaves_the_address_bar(url, token, look):
    seen = look(f"{url}#token={token}")
    page = seen.is_live()
    assert page.url == url
    assert token not in str(page.evaluate("[location.href, document.referrer]"))
    cookies = seen.context.cookies()
    assert [(cookie["httpOnly"], cookie["sameSite"]) for cookie in cookies] == [(True, "Strict")]
    assert token not in cookies[0]["value"]
    # Once more with it, as from a bookmark: it is not needed, and goes away all the same.
    page.goto("about:blank")
    page.goto(f"{url}#token={token}")
    page.wait_for_selector("#board[data-drawn]", timeout=60_000)
    assert page.url == url


@pytest.mark.slow
def test_a_websocket_from_another_page_is_refused_though_the_cookie_is_there(url, token, elsewhere, look, guarded):
    seen = look(f"{url}#token={token}", allowed=FORBIDDEN)
    seen.is_live()
    other = seen.context.new_page()
    seen.origins.add(urlsplit(elsewhere).netloc)
    other.goto(elsewhere)
    ends = other.evaluate(
        """(url) => new Promise((end) => {
          const socket = new WebSocket(url.replace("http", "ws") + "live");
          socket.onopen = () => end("open");
          socket.onclose = () => end("refused");
        })""",
        url,
    )
    assert ends == "refused"
    assert guarded.service.outputs.page.viewers.refused["origin"] == 1
    answer = other.evaluate("(url) => fetch(url, {credentials: 'include'}).then((a) => a.text(), () => 'kept')", url)
    assert answer == "kept"
    assert (
        other.evaluate("(url) => fetch(url + 'login', {method: 'POST', body: '{}'}).then(() => 1, () => 0)", url) == 0
    )

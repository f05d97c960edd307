"""Who may look, over real sockets: what is wrong is refused with the same headers as all else, and counted."""

from __future__ import annotations

import stat

import aiohttp
import pytest
from web_rig import ANYWHERE, HERE, Filing, Noting, Rig, run, token_in

from quavelet.core.errors import SettingsError
from quavelet.settings import WebSettings
from quavelet.web.access import Access, is_loopback, token_at, token_path

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)


def test_on_this_machine_no_token_is_asked_for():
    async def scenario(rig: Rig) -> None:
        assert (await rig.ask("/")).code == 200
        async with rig.viewer() as viewer:
            await viewer.until("hello")
        assert rig.said == [f"the page is at http://127.0.0.1:{rig.page.port}/"]

    run(scenario)


def test_from_elsewhere_nothing_but_the_login_is_shown_without_the_token():
    async def scenario(rig: Rig) -> None:
        token = token_in(rig.said)
        page = await rig.ask("/")
        assert page.code == 200 and b"token" in page.body and page.body != (await known(rig)).body
        assert (await rig.ask("/live")).code == 401
        assert (await rig.ask("/recordings/a.imu")).code == 401
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            async with rig.viewer():
                pass
        assert refused.value.status == 401
        for wrong in ("", "x", token[:-1], token + "x", token.swapcase(), "é" * 40):
            assert (await rig.login(wrong)).code == 403
        assert rig.refused == {"token": 9}

    run(scenario, listen=ANYWHERE, abilities=(Filing({}),))


async def known(rig: Rig):
    return await rig.ask("/", Cookie=await rig.cookie())


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[]", b'{"token":1}', b'{"token":"' + b"x" * 3000 + b'"}', b"\xff\xfe", b"[" * 1500]
)
def test_a_login_that_is_none_is_refused(body):
    async def scenario(rig: Rig) -> None:
        assert (await rig.ask("/login", method="POST", body=body, Origin=rig.origin)).code == 403
        assert rig.refused == {"token": 1}

    run(scenario, listen=ANYWHERE)


def test_the_cookie_that_the_token_gives_is_kept_from_scripts_and_other_sites_and_opens_all():
    async def scenario(rig: Rig) -> None:
        given = await rig.login(token_in(rig.said))
        cookie, _, how = given.headers["set-cookie"].partition("; ")
        assert set(how.split("; ")) == {"HttpOnly", "SameSite=Strict", "Path=/", "Max-Age=31536000"}
        assert token_in(rig.said) not in given.headers["set-cookie"]
        async with rig.viewer(Cookie=cookie) as viewer:
            await viewer.until("hello")
        for wrong in (cookie[:-1], cookie + "0", cookie.partition("=")[0] + "=", "quavelet=" + token_in(rig.said)):
            assert (await rig.ask("/live", Cookie=wrong)).code == 401

    run(scenario, listen=ANYWHERE)


def test_the_cookie_is_good_after_a_restart_and_the_token_is_printed_once(tmp_path):
    kept: list[str] = []

    async def first(rig: Rig) -> None:
        kept.append(await rig.cookie())

    async def second(rig: Rig) -> None:
        assert not [line for line in rig.said if "token=" in line]
        assert (await rig.ask("/live", Cookie=kept[0])).code == 426

    environ = {"STATE_DIRECTORY": f"{tmp_path}:/elsewhere"}
    run(first, listen=ANYWHERE, environ=environ)
    run(second, listen=ANYWHERE, environ=environ)
    file = tmp_path / "imu.token"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_where_the_page_is_and_where_its_token_is_kept_are_said(tmp_path):
    file = tmp_path / "token"
    file.write_text("x" * 20)
    file.chmod(0o600)

    async def scenario(rig: Rig) -> None:
        (said,) = rig.said
        assert said.endswith(f":{rig.page.port}/; its token is in {file}") and "0.0.0.0" not in said
        assert (await rig.login("x" * 20)).code == 204

    run(scenario, listen=ANYWHERE, token_file=str(file))


def test_without_a_place_for_it_the_token_is_another_at_each_start():
    seen: list[str] = []

    async def scenario(rig: Rig) -> None:
        seen.append(token_in(rig.said))

    run(scenario, listen=ANYWHERE)
    run(scenario, listen=ANYWHERE)
    assert len(set(seen)) == 2 and min(map(len, seen)) >= 43


def test_a_page_that_opens_again_keeps_its_token_and_does_not_say_it_again():
    async def scenario(rig: Rig) -> None:
        cookie = await rig.cookie()
        await rig.page.close()
        await rig.page.open()
        assert len(rig.said) == 1
        assert (await rig.ask("/live", Cookie=cookie)).code == 426

    run(scenario, listen=ANYWHERE)


def test_a_tokens_file_that_all_can_read_is_refused(tmp_path):
    file = tmp_path / "token"
    file.write_text("x" * 20 + "\n")
    file.chmod(0o644)
    with pytest.raises(SettingsError, match="chmod 600"):
        token_at(file)
    file.chmod(0o640)
    assert token_at(file) == ("x" * 20, False)


@pytest.mark.parametrize(
    "content", [b"", b"short\n", b"has a space in the middle", b"\xff" * 20, b"x" * 600, b"two\nlines" * 4]
)
def test_a_tokens_file_without_a_token_is_told_of(tmp_path, content):
    file = tmp_path / "token"
    file.write_bytes(content)
    file.chmod(0o600)
    with pytest.raises(SettingsError, match="token_file"):
        token_at(file)


def test_a_token_is_never_written_through_a_link_that_leads_nowhere(tmp_path):
    link = tmp_path / "imu.token"
    link.symlink_to(tmp_path / "victim")
    with pytest.raises(SettingsError, match="cannot be written"):
        token_at(link)
    assert not (tmp_path / "victim").exists()
    with pytest.raises(SettingsError, match="is no file"):
        token_at(tmp_path)
    with pytest.raises(SettingsError, match="cannot be written"):
        token_at(tmp_path / "missing" / "imu.token")


def test_where_the_token_is_kept(tmp_path):
    def place(text: str, **environ: str):
        return token_path(WebSettings(token_file=text), name="imu", environ=environ)

    assert place("auto") is None
    assert place("") is None
    assert place("auto", STATE_DIRECTORY=str(tmp_path)) == tmp_path / "imu.token"
    assert place(str(tmp_path / "t"), STATE_DIRECTORY="/elsewhere") == tmp_path / "t"


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1", "http://localhost:8050", ""])
def test_another_page_in_the_same_browser_cannot_look_on(origin):
    async def scenario(rig: Rig) -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            async with rig.viewer(origin=origin or "http://"):
                pass
        assert refused.value.status == 403
        assert (await rig.ask("/live", Upgrade="websocket")).code == 403
        assert rig.refused == {"origin": 2}

    run(scenario)


def test_another_page_cannot_log_in():
    async def scenario(rig: Rig) -> None:
        assert (await rig.login(token_in(rig.said), origin="http://evil.example")).code == 403
        assert rig.refused == {"origin": 1}

    run(scenario, listen=ANYWHERE)


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8050",
        "localhost.evil.example",
        "10.0.0.1",
        "[::2]",
        "::1",
        "@localhost",
        "localhost:x",
    ],
)
def test_a_name_that_was_made_to_point_here_is_refused(host):
    async def scenario(rig: Rig) -> None:
        for path in ("/", "/assets/app.js", "/live", "/recordings/x"):
            assert (await rig.ask(path, host=host)).code == 403
        assert rig.refused == {"host": 4}

    run(scenario)


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9000", "127.0.0.1", "127.0.0.2:80", "[::1]:8050", "[::1]"])
def test_this_machine_goes_by_several_names(host):
    assert Access("", port=1).refusal_of_host([host]) == ""
    assert is_loopback(host.partition(":")[0].lower()) or host.startswith("[")


def test_a_request_without_a_host_or_with_two_is_refused():
    async def scenario(rig: Rig) -> None:
        assert (await rig.raw(b"GET / HTTP/1.0\r\n\r\n")).startswith(b"HTTP/1.0 403 ")
        two = await rig.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\nConnection: close\r\n\r\n")
        assert two.split(b" ")[1] in (b"400", b"403")

    run(scenario)


OUTSIDE = [
    "/assets/../page.py",
    "/assets/..%2fpage.py",
    "/assets/%2e%2e/page.py",
    "/assets/%2e%2e%2fpage.py",
    "/assets/..%5cpage.py",
    "/assets/....//page.py",
    "/assets//etc/passwd",
    "/assets/%00",
    "/assets/style.css%00.txt",
    "/assets/%c0%ae%c0%ae/page.py",
    "/assets/..;/page.py",
    "/assets/vendor/../../page.py",
    "/assets/./style.css",
    "/assets/",
    "/assets",
    "//assets/style.css",
    "/../../etc/passwd",
    "/page.py",
    "/etc/passwd",
    "/recordings/../imu.token",
    "/recordings/..%2f..%2fetc%2fpasswd",
    "/recordings/%2fetc%2fpasswd",
    "/recordings/",
    "http://evil.example/",
    "*",
]


def test_nothing_but_the_pages_own_files_is_served_in_any_spelling(tmp_path):
    async def scenario(rig: Rig) -> None:
        for path in OUTSIDE:
            assert (await rig.ask(path)).code in (400, 404), path

    file = tmp_path / "a.imu"
    file.write_bytes(b"x")
    run(scenario, abilities=(Filing({"a.imu": file}),))


def test_every_answer_has_the_headers_that_shut_the_page_in():
    async def scenario(rig: Rig) -> None:
        answers = [
            await rig.ask("/"),
            await rig.ask("/nothing"),
            await rig.ask("/assets/login.html"),
            await rig.ask("/", method="POST"),
            await rig.ask("/", method="DELETE"),
            await rig.ask("/login"),
            await rig.ask("/login", method="POST", Origin=rig.origin),
            await rig.ask("/live"),
            await rig.ask("/", host="evil.example"),
            await rig.ask("/" + "x" * 10_000),
            await rig.ask("/", X="y" * 10_000),
        ]
        garbage = [await rig.raw(b"\x16\x03\x01\r\n\r\n"), await rig.raw(b"GET\r\n\r\n")]
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{rig.origin}/live", origin=rig.origin) as live,
        ):
            upgraded = {name.lower(): value for name, value in live._response.headers.items()}
        codes = []
        for one in [*(answer.headers for answer in answers), upgraded, *map(headers_of, garbage)]:
            assert one["content-security-policy"] == POLICY
            assert one["x-content-type-options"] == "nosniff"
            assert one["referrer-policy"] == "no-referrer"
            assert one["cross-origin-resource-policy"] == "same-origin"
            assert one["server"] == "quavelet"
        codes = [answer.code for answer in answers]
        assert codes == [200, 404, 200, 405, 405, 405, 403, 426, 403, 400, 400]

    run(scenario)


@pytest.mark.parametrize(("listen", "policy"), [(HERE, "same-origin"), (ANYWHERE, None)])
def test_a_header_that_browsers_complain_of_without_tls_is_sent_on_this_machine_only(listen, policy):
    async def scenario(rig: Rig) -> None:
        assert (await rig.ask("/")).headers.get("cross-origin-opener-policy") == policy

    run(scenario, listen=listen)


def headers_of(whole: bytes) -> dict[str, str]:
    lines = whole.partition(b"\r\n\r\n")[0].decode().split("\r\n")[1:]
    return {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}


def test_asking_by_get_changes_nothing():
    noting = Noting()

    async def scenario(rig: Rig) -> None:
        for path in ("/", "/live?n=1&ability=note&what=note", "/note", "/login?token=x", "/recordings/x"):
            for method in ("GET", "HEAD", "PUT", "DELETE", "OPTIONS", "POST"):
                answer = await rig.ask(path, method=method)
                assert "set-cookie" not in answer.headers
        assert noting.done == []

    run(scenario, abilities=(noting,))


def test_files_of_the_page_are_asked_for_again_but_sent_once():
    async def scenario(rig: Rig) -> None:
        first = await rig.ask("/assets/login.html")
        assert first.headers["cache-control"] == "no-store"
        style = await rig.ask("/assets/style.css", Accept_Encoding="gzip")
        if style.code == 404:
            pytest.skip("the page has no style yet")
        assert style.headers["cache-control"] == "no-cache"
        assert style.headers["content-type"] == "text/css; charset=utf-8"
        again = await rig.ask("/assets/style.css", If_None_Match=style.headers["etag"])
        assert (again.code, again.body) == (304, b"")
        head = await rig.ask("/assets/style.css", method="HEAD")
        assert (head.code, head.body) == (200, b"") and int(head.headers["content-length"]) > 0

    run(scenario)


def test_a_recording_is_downloaded_whole_and_as_a_file(tmp_path):
    file = tmp_path / "a b.imu"
    file.write_bytes(bytes(range(256)) * 4000)

    async def scenario(rig: Rig) -> None:
        got = await rig.ask("/recordings/a%20b.imu")
        assert got.code == 200 and got.body == file.read_bytes()
        assert got.headers["content-disposition"] == "attachment; filename*=UTF-8''a%20b.imu"
        assert got.headers["content-security-policy"] == POLICY
        head = await rig.ask("/recordings/a%20b.imu", method="HEAD")
        assert head.headers["content-length"] == str(file.stat().st_size) and not head.body
        assert (await rig.ask("/recordings/gone.imu")).code == 404
        assert (await rig.ask("/recordings/other.imu")).code == 404

    run(scenario, abilities=(Filing({"a b.imu": file, "gone.imu": tmp_path / "gone"}),))

"""Whatever a viewer says, it gets an answer or is closed: nothing is raised beyond that, and nothing else is done."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from output_plans import STATUS
from web_rig import Noting

from quavelet.core.clock import VirtualClock
from quavelet.settings import WebSettings
from quavelet.web.page import WebPage
from quavelet.web.viewers import Viewer

json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
asked = st.fixed_dictionaries(
    {},
    optional={
        "n": st.integers() | json_values,
        "ability": st.sampled_from(["note", "other"]) | json_values,
        "what": st.sampled_from(["look", "refuse"]) | json_values,
        "values": st.dictionaries(st.text(max_size=8), json_values, max_size=3) | json_values,
        "ping": st.integers() | json_values,
        "else": json_values,
    },
)


class Writing(asyncio.Transport):
    """A transport that keeps what is written."""

    def __init__(self) -> None:
        super().__init__()
        self.written: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.written.append(bytes(data))

    def is_closing(self) -> bool:
        return False

    def get_write_buffer_size(self) -> int:
        return 0


class Careful(Noting):
    """It notes only what it was made for, as every ability must."""

    def do(self, what: str, values: Mapping[str, object]) -> str:
        assert isinstance(what, str) and isinstance(values, dict)
        return super().do(what, values)


def hear(text: str) -> tuple[bool, list[dict[str, object]], Careful]:
    """Whether it was taken, the answers, and the ability."""
    careful = Careful()
    page = WebPage(
        WebSettings(listen="127.0.0.1:0"),
        src="fake:tilt",
        name="imu",
        status=lambda: STATUS,
        abilities=(careful,),
        talk=lambda _: None,
        clock=VirtualClock(),
        environ={},
    )
    page.begin()
    transport = Writing()
    viewer = Viewer(transport, lambda: True, now_s=0.0)
    page.viewers.join(viewer)
    try:
        page.heard(viewer, text)
    except ValueError:
        return False, [], careful
    return True, [msgspec.json.decode(frame[frame.index(b"{") :]) for frame in transport.written], careful


@given(st.one_of(json_values, asked).map(lambda value: msgspec.json.encode(value).decode()))
def test_any_json_is_answered_once_or_refused(text):
    taken, said, careful = hear(text)
    if taken:
        assert [frame["is"] for frame in said if frame["is"] != "ability"] in (["answer"], ["pong"])
    else:
        assert careful.done == []


@given(st.text())
def test_any_text_is_answered_or_refused(text):
    hear(text)


def test_a_number_too_large_for_the_answer_is_given_back_or_refused():
    for n in (2**31, 2**63 - 1, 2**63, 2**64, -(2**63) - 1, 10**40, 1e300):
        hear(f'{{"n":{n},"ability":"note","what":"look"}}')
        hear(f'{{"ping":{n}}}')

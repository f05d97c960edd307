"""The page's own files, read as text: what the CSP would refuse, what would leave the origin, what has no name."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import product
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "src" / "quavelet" / "web" / "page"
HTML = ("index.html", "login.html")
SCRIPTS = sorted(path.name for path in PAGE.glob("*.js"))
SHEETS = sorted(path.name for path in PAGE.glob("*.css"))
VOID = {"meta", "link", "input", "img", "br", "path", "rect", "circle"}
CONTROLS = {"button", "input", "select", "canvas", "section", "fieldset", "textarea"}


class Element:
    def __init__(self, tag: str, attributes: dict[str, str], parents: list[Element]) -> None:
        self.tag, self.attributes, self.parents, self.text = tag, attributes, parents, ""


class Reader(HTMLParser):
    def __init__(self, name: str) -> None:
        super().__init__()
        self.elements: list[Element] = []
        self._open: list[Element] = []
        self.feed((PAGE / name).read_text(encoding="utf-8"))
        assert not self._open, f"{self._open[-1].tag} is not closed"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {name: value or "" for name, value in attrs}, list(self._open))
        self.elements.append(element)
        if tag not in VOID:
            self._open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(Element(tag, {name: value or "" for name, value in attrs}, list(self._open)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop().tag == tag

    def handle_data(self, data: str) -> None:
        for element in self._open:
            element.text += data

    def ids(self) -> list[str]:
        return [e.attributes["id"] for e in self.elements if "id" in e.attributes]


@pytest.fixture(params=HTML)
def html(request: pytest.FixtureRequest) -> Reader:
    return Reader(request.param)


def script(name: str) -> str:
    """Without its comments."""
    text = (PAGE / name).read_text(encoding="utf-8")
    return re.sub(r"/\*.*?\*/|(?<!:)//[^\n]*", "", text, flags=re.S)


def test_the_content_policy_refuses_something_in_the_markup(html: Reader):
    for element in html.elements:
        assert element.tag not in ("style", "base", "iframe", "object", "embed")
        assert not [name for name in element.attributes if name == "style" or name.startswith("on")]
        if element.tag == "script":
            assert element.attributes["src"] and not element.text.strip()


def test_a_file_named_in_the_markup_is_not_there_or_is_elsewhere(html: Reader):
    for element in html.elements:
        for name in ("src", "href", "action"):
            target = element.attributes.get(name)
            if target is None or target.startswith(("#", "data:image/svg+xml,")):
                continue
            assert target.startswith("/assets/"), target
            assert (PAGE / target.removeprefix("/assets/")).is_file(), target


def test_an_id_is_missing_or_is_there_twice(html: Reader):
    ids = html.ids()
    assert len(ids) == len(set(ids))
    for element in html.elements:
        for name in ("aria-labelledby", "aria-describedby", "for"):
            for wanted in element.attributes.get(name, "").split():
                if not wanted.endswith("-title") or wanted in ids:
                    assert wanted in ids, wanted
                else:
                    made_by_scripts = "".join(script(name) for name in SCRIPTS)
                    assert f'id: "{wanted}"' in made_by_scripts, wanted


def test_a_control_or_a_part_of_the_page_has_no_name(html: Reader):
    labels = {e.attributes["for"] for e in html.elements if e.tag == "label"}
    for element in html.elements:
        if element.tag not in CONTROLS and element.attributes.get("role") != "img":
            continue
        a = element.attributes
        named = a.get("aria-label") or a.get("aria-labelledby") or a.get("id") in labels
        by_text = element.tag in ("button", "fieldset") and element.text.strip()
        assert named or by_text, (element.tag, a)


def test_there_is_no_way_to_the_main_part_for_the_keyboard_or_a_reader():
    page = Reader("index.html")
    tags = [e.tag for e in page.elements]
    for landmark in ("header", "main", "footer"):
        assert tags.count(landmark) == 1
    assert tags.count("h1") == 1
    first = next(e for e in page.elements if e.tag == "a")
    assert first.attributes["href"] == "#main"
    for e in page.elements:
        assert int(e.attributes.get("tabindex", "0")) <= 0
    assert [e.attributes["aria-live"] for e in page.elements if "aria-live" in e.attributes].count("assertive") == 1


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_asks_for_an_id_that_the_page_does_not_have(name: str):
    ids = set(Reader("index.html").ids()) | set(Reader("login.html").ids())
    for wanted in re.findall(r"(?:byId|getElementById)\(\"([^\"]+)\"\)", script(name)):
        assert wanted in ids
    for pattern in re.findall(r"(?:byId)\(`([^`]+)`\)", script(name)):
        made = re.compile(re.sub(r"\\\$\\\{.*?\\\}", ".+", re.escape(pattern)))
        assert any(made.fullmatch(known) for known in ids), pattern


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_makes_markup_of_text_or_code_of_text(name: str):
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function", "cssText"):
        assert word not in script(name)
    assert not re.search(r"setAttribute\(\s*\"style\"|style: ", script(name))


@pytest.mark.parametrize("name", SCRIPTS + SHEETS)
def test_something_is_fetched_from_elsewhere(name: str):
    text = script(name)
    assert "://" not in text.replace('"wss" : "ws"}://', "")
    for target in re.findall(r"(?:from|import\()\s*\"([^\"]+)\"", text):
        assert target.startswith("./") and (PAGE / target).is_file(), target
    assert not re.search(r"@import|url\(", text)


def colours(block: str) -> dict[str, str]:
    return dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", block))


def themes() -> dict[str, dict[str, str]]:
    text = (PAGE / "style.css").read_text(encoding="utf-8")
    blocks = re.findall(r":root([^{,]*) \{(.*?)\}", text, re.S)
    return {head: colours(body) for head, body in blocks if colours(body)}


def brightness(colour: str) -> float:
    """Relative luminance as WCAG 2.2 has it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    r, g, b = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def contrast(a: str, b: str) -> float:
    low, high = sorted((brightness(a), brightness(b)))
    return (high + 0.05) / (low + 0.05)


WRITTEN_ON = [
    *product(("ink", "quiet", "accent", "x", "y", "z", "t", "good", "warn", "bad", "move"), ("card",)),
    *product(("ink", "quiet"), ("ground", "sky", "earth", "soft", "good-soft", "warn-soft", "bad-soft")),
    *((level, f"{level}-soft") for level in ("good", "warn", "bad", "move", "fake")),
    ("fake", "fake-stripe"),
    ("accent-ink", "accent"),
    ("card", "bad"),
    ("card", "ink"),
]


@pytest.mark.parametrize("head", ["", '[data-theme="dark"]', ":not([data-theme])"])
def test_words_are_too_pale_to_read(head: str):
    theme = themes()[head]
    pale = {pair: contrast(theme[pair[0]], theme[pair[1]]) for pair in WRITTEN_ON}
    assert not {pair: ratio for pair, ratio in pale.items() if ratio < 4.5}


def test_dark_by_the_system_is_not_dark_by_choice():
    found = themes()
    assert found['[data-theme="dark"]'] == found[":not([data-theme])"]
    assert set(found[""]) == set(found[":not([data-theme])"])

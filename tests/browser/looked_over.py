"""What can be measured of a page by looking at every element: names, colours, sizes, focus. All run in the page."""

from __future__ import annotations

from playwright.sync_api import Page

CONTROLS = "a[href], button, input, select, textarea, summary, [tabindex]:not([tabindex='-1'])"
LEAST_PX = 24
"""WCAG 2.2, 2.5.8: a target is 24 by 24 CSS px at least, but for a link in a sentence."""

# Each piece of text that can be seen with the worst contrast (WCAG 2.x, 1.4.3) over all that may lie behind it: every
# colour of a gradient counts as the ground. What is not active (greyed, disabled) is let be, as WCAG does.
_CONTRASTS = """() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  canvas.canvas.width = canvas.canvas.height = 1;
  const parsed = (text) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = text;
    canvas.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = (top, ground) => [0, 1, 2].map((k) => top[k] * top[3] + ground[k] * (1 - top[3])).concat(1);
  const light = ([r, g, b]) => {
    const [R, G, B] = [r, g, b].map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * R + 0.7152 * G + 0.0722 * B;
  };
  const contrast = (a, b) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05);
  const grounds = (element) => {
    if (!element) return [[255, 255, 255, 1]];
    const style = getComputedStyle(element);
    const own = [parsed(style.backgroundColor)];
    const stops = style.backgroundImage.match(/(rgba?|color|oklab|oklch|hsla?)\\([^)]*\\)/g) ?? [];
    own.push(...stops.map(parsed));
    if (own.every((c) => c[3] === 1) || (own[0][3] === 1 && stops.length)) return own;
    const below = grounds(element.parentElement);
    return own.flatMap((top) => below.map((ground) => over(top, ground)));
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.nodeValue.trim();
    const element = walker.currentNode.parentElement;
    if (!text || !element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (element.closest(".unseen, .skip, noscript, script, :disabled, [aria-disabled=true]")) continue;
    if (element.getClientRects().length === 0) continue;
    const style = getComputedStyle(element);
    const worst = Math.min(...grounds(element).map((ground) => contrast(over(parsed(style.color), ground), ground)));
    const px = parseFloat(style.fontSize), large = px >= 24 || (px >= 18.66 && Number(style.fontWeight) >= 700);
    // What is hidden from readers is a part of a picture (1.4.11).
    const picture = element.closest("[aria-hidden=true]");
    found.push({ text: text.slice(0, 40), contrast: worst, least: large || picture ? 3 : 4.5 });
  }
  return found;
}"""

_SMALL = """([controls, least]) => [...document.querySelectorAll(controls)].map((control) => {
  const target = control.matches("input[type=radio]") ? control.labels[0] : control;
  const box = target.getBoundingClientRect();
  const shown = target.checkVisibility({ visibilityProperty: true }) && !target.matches(".skip");
  const inText = getComputedStyle(target).display === "inline";
  return shown && !inText && (box.width < least || box.height < least)
    ? `${target.id} ${target.textContent.trim().slice(0, 30)}: ${box.width.toFixed(0)} x ${box.height.toFixed(0)}`
    : null;
}).filter(Boolean)"""

_WHERE = """() => {
  const one = document.activeElement;
  if (!one || one === document.body) return null;
  // Some are not seen themselves: what stands for them is.
  const shown = one.type === "radio" ? one.labels[0] : one.matches(".track input") ? one.parentElement : one;
  const style = getComputedStyle(shown);
  const drawn = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2;
  one.dataset.reached ??= String(document.querySelectorAll("[data-reached]").length);
  const box = shown.getBoundingClientRect();
  const inView = box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth;
  return { n: Number(one.dataset.reached), what: one.id || one.textContent.trim().slice(0, 40), drawn, inView };
}"""

# A group of radio buttons is one stop: the arrows go on within it.
_UNREACHED = """(controls) => [...document.querySelectorAll(controls)]
  .filter((one) => one.checkVisibility({ visibilityProperty: true }) && !one.disabled && !("reached" in one.dataset))
  .filter((one) => !(one.type === "radio" && document.querySelector(`[name="${one.name}"][data-reached]`)))
  .map((one) => one.outerHTML.slice(0, 100))"""


def low_contrasts(page: Page) -> list[dict[str, object]]:
    """Text that cannot be read well; none where there is no text at all, so look whether there is."""
    texts = page.evaluate(_CONTRASTS)
    assert len(texts) > 5
    return [one for one in texts if one["contrast"] < one["least"]]


def small_targets(page: Page) -> list[str]:
    """What a finger misses."""
    return page.evaluate(_SMALL, [CONTROLS, LEAST_PX])


def tabbed(page: Page) -> list[dict[str, object]]:
    """What has the focus, one after the other, until it begins again; {n, what, drawn, inView}."""
    stops: list[dict[str, object]] = []
    for _ in range(200):
        page.keyboard.press("Tab")
        where = page.evaluate(_WHERE)
        if where is None or where["n"] < len(stops):
            return stops
        stops.append(where)
    raise AssertionError("Tab does not come back to the beginning")


def unreached(page: Page) -> list[str]:
    """Controls that `tabbed` did not come to."""
    return page.evaluate(_UNREACHED, CONTROLS)


def nameless(page: Page) -> list[str]:
    """Controls and pictures without a name for a screen reader, as the browser itself tells it."""
    session = page.context.new_cdp_session(page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    roles = {"button", "link", "textbox", "slider", "combobox", "radio", "checkbox", "img", "image", "progressbar"}
    roles |= {"table", "region", "radiogroup", "DisclosureTriangle"}
    looked_at = [node for node in nodes if not node["ignored"] and node["role"]["value"] in roles]
    assert len(looked_at) > 3
    return [
        f"{node['role']['value']} {node.get('properties')}"
        for node in looked_at
        if not node.get("name", {}).get("value")
    ]


def scrolls_sideways(page: Page) -> list[str]:
    """What is wider than the window."""
    return page.evaluate("""() => document.documentElement.scrollWidth <= document.documentElement.clientWidth ? [] :
      [...document.body.querySelectorAll("*")].filter((e) => e.getBoundingClientRect().right > innerWidth + 0.5)
        .map((e) => e.outerHTML.slice(0, 80)).concat("the page")""")

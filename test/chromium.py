"""The machine's Chromium, driven by playwright."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import pytest

_PATH = shutil.which("chromium")
NEEDS_CHROMIUM = pytest.mark.skipif(_PATH is None, reason="no chromium on this machine")
# A small picture is drawn soon where a machine has no graphics [pixels].
SMALL = {"width": 900, "height": 600}
# Where a machine has no graphics, WebGL by software.
_OPTIONS = [
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--js-flags=--expose-gc"),
    "--enable-precise-memory-info",
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser; tests with it are left out where there is no playwright."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="no playwright: pip install playwright"
    )
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=_PATH, args=_OPTIONS)
        yield chromium
        chromium.close()


# Returns the words of a page whose contrast is below 4.5, as WCAG 2 defines it, with the contrast.
# What is disabled may be paler.
OF_CONTRAST = """
() => {
  const parse = (colour) => {
    const numbers = colour.match(/[\\d.]+/g).map(Number);
    return numbers.length < 4 ? [...numbers, 1] : numbers;
  };
  const linear = (v) => (v <= 10.31 ? v / 3294.6 : Math.pow((v / 255 + 0.055) / 1.055, 2.4));
  const light = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const over = (a, b) => [0, 1, 2].map((k) => a[k] * a[3] + b[k] * (1 - a[3]));
  const ground = (element) => {
    const layers = [];
    for (let node = element; node; node = node.parentElement)
      layers.push(parse(getComputedStyle(node).backgroundColor));
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text; (text = texts.nextNode()); ) {
    const element = text.parentElement, words = text.textContent.trim();
    const box = element.getBoundingClientRect(), style = getComputedStyle(element);
    if (!words || !box.width || style.visibility === "hidden") continue;
    if (element.closest("[disabled], [data-disabled], style, script, title")) continue;
    const below = ground(element);
    const colour = element instanceof SVGElement ? style.fill : style.color;
    const lights = [light(over(parse(colour), below)), light(below)];
    const contrast = (Math.max(...lights) + 0.05) / (Math.min(...lights) + 0.05);
    if (contrast < 4.5) found.push([words, contrast]);
  }
  return found;
}
"""

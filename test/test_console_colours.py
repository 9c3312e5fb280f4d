"""The console's colours: words that can be read, kinds that colour-blind people tell apart."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ff_planner_ros.console import colours
from ff_planner_ros.console.live.measured import COLOUR as MEASURED
from ff_planner_ros.console.scene import FAULT, KINDS

# Machado, Oliveira and Fernandes (2009), severity 1: linear RGB as seen without one kind of cone.
SEEN = {
    "all": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
# Of colours beside each other; 2.3 is just noticeable. Lit surfaces vary by about 10.
APART = 12.0
OF_SCENE = {**KINDS, "measured": MEASURED, "fault": FAULT}


def linear(rgb: tuple[int, int, int]) -> np.ndarray:
    """Return linear RGB, by the definition of sRGB."""
    share = np.array(rgb) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(seen: np.ndarray) -> np.ndarray:
    """Return CIELAB of linear RGB, white D65."""
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    x, y, z = np.cbrt((to_xyz @ np.clip(seen, 0.0, 1.0)) / [0.95047, 1.0, 1.08883])
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def of_hex(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, as WCAG 2 defines it."""
    light = [float(linear(of_hex(c)) @ [0.2126, 0.7152, 0.0722]) for c in (one, other)]
    return (max(light) + 0.05) / (min(light) + 0.05)


def test_contrast_is_that_of_the_standard() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("text", ["TEXT", "GOOD", "BAD", "PALE", "BUTTON", "HOVER"])
@pytest.mark.parametrize("paper", ["#ffffff", colours.CHOSEN_ROW])
def test_words_can_be_read(text: str, paper: str) -> None:
    assert contrast(getattr(colours, text), paper) >= 4.5


@pytest.mark.parametrize("eyes", SEEN)
def test_what_is_drawn_is_told_apart_by_all_eyes(eyes: str) -> None:
    found = {
        (one, other): float(
            np.linalg.norm(
                lab(SEEN[eyes] @ linear(OF_SCENE[one])) - lab(SEEN[eyes] @ linear(OF_SCENE[other]))
            )
        )
        for one, other in itertools.combinations(OF_SCENE, 2)
    }
    assert {pair: apart for pair, apart in found.items() if apart < APART} == {}


@pytest.mark.parametrize("eyes", SEEN)
def test_curves_are_told_apart_by_all_eyes(eyes: str) -> None:
    seen = [lab(SEEN[eyes] @ linear(one)) for one in colours.CURVES]
    apart = [float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2)]
    assert min(apart) >= APART

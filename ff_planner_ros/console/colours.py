"""Colours of the page: distinct for colour-blind people, and text with enough contrast."""

from __future__ import annotations

RGB = tuple[int, int, int]

# Of the scene and the curves, by Okabe and Ito.
BLACK, GREY = (0, 0, 0), (195, 195, 195)
ORANGE, SKY, GREEN, BLUE = (230, 159, 0), (86, 180, 233), (0, 158, 115), (0, 114, 178)
VERMILION, PURPLE = (213, 94, 0), (204, 121, 167)
LINE = (40, 40, 40)
# Curves have these in turn; a second turn is dashed.
CURVES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, BLACK)

# Of words, each on the white of the panels and on the rows that are chosen.
CHOSEN_ROW = "#e6eef5"
TEXT, GOOD, BAD = "#212529", "#00543d", "#963f00"
PALE, BUTTON, HOVER = "#495057", "#0064a0", "#00507f"
STYLE = (
    "<style>"
    # viser's own words and buttons are paler than can be read.
    f":root {{--mantine-color-dimmed: {PALE} !important;"
    f" --mantine-primary-color-filled: {BUTTON} !important;"
    f" --mantine-primary-color-filled-hover: {HOVER} !important;"
    f" --mantine-color-blue-filled: {BUTTON} !important;"
    f" --mantine-color-blue-filled-hover: {HOVER} !important}}"
    ".mantine-Notification-description, .mantine-Slider-markLabel, .u-legend .u-value"
    f" {{color: {PALE} !important}}"
    f".ff {{font-size: 11px; line-height: 1.35; color: {TEXT}}}"
    ".ff p {margin: 4px 12px} .ff table {border-collapse: collapse; width: 100%}"
    ".ff th {font-weight: normal} .ff th, .ff td {text-align: right; padding: 2px 3px;"
    " vertical-align: top}"
    ".ff :is(th, td):first-child {text-align: left; overflow-wrap: anywhere; min-width: 6em}"
    f".ff .chosen {{font-weight: bold; background: {CHOSEN_ROW}}}"
    f".ff .good {{color: {GOOD}}} .ff .bad {{color: {BAD}; font-weight: bold}}"
    "</style>"
)


def css(colour: RGB) -> str:
    """Return a colour as the browser takes it."""
    return f"rgb({colour[0]}, {colour[1]}, {colour[2]})"

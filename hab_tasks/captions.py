"""Captions of video frames."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

LEGEND = "arrows: orange target, green goal, blue handle"
"""Colours of the markers of a task."""

Frame = NDArray[np.uint8]

FONT_PX = 18
LINE_PX = 24
MARGIN_PX = 10


def with_words(picture: Frame, lines: Sequence[str], room: int) -> Frame:
    """Returns an image (H, W, 3) with a caption of `room` lines on a black strip below.

    Long lines are wrapped, and overflow is cut off. `room` is constant within a video, so that all
    frames have one size.
    """
    width = picture.shape[1]
    words = Image.new("RGB", (width, room * LINE_PX))
    draw, font = ImageDraw.Draw(words), _font()
    letters = max(int((width - 2 * MARGIN_PX) / font.getlength("n")), 1)
    broken = [part for line in lines for part in textwrap.wrap(line, letters)]
    for number, line in enumerate(broken[:room]):
        draw.text((MARGIN_PX, number * LINE_PX), line, fill="white", font=font)
    return np.concatenate([picture, np.asarray(words)])


@lru_cache(maxsize=1)
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(FONT_PX)

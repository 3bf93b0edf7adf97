"""Frames of widgets for the site: pictures of one control from end to end, which a page without a kernel shows.

`python .ci/notebooks.py execute` appends a cell that calls `write_frames`; `conf.py` puts what it wrote into the page.
"""

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
from course.widgets import SHOWN, Explorer, first_line, number_of, told_of

FRAMES = 21  # of a control at most, on a page without a kernel
TALLEST = 16_383  # pixels of a WebP picture, which holds them one below the other


def frames_of(explorer: Explorer, name: str = "") -> Iterator[tuple[str, bytes, str]]:
    """The value of a control, by default of the one that moves, the picture and what it says, from end to end.

    What is refused is left out. The controls and what is displayed are as before.
    """
    name = name or explorer.motion
    control, shown = explorer.controls[name], explorer.displayed
    first, most = control.value, min(FRAMES, TALLEST // PIL.Image.open(io.BytesIO(explorer.png)).height)
    explorer.displayed = None
    try:
        for value in places(control, explorer.named if name == explorer.motion else (), most):
            explorer.set(**{name: value})
            if not explorer.error:
                yield number_of(value), explorer.png, told_of(explorer.numbers)
    finally:
        explorer.set(**{name: first})
        explorer.displayed = shown


def write_frames(folder: Path, stem: str, code: str) -> None:
    """Write the frames of all widgets that were displayed: a picture of one below the other, and what they say.

    `code` says which code they are of.
    """
    told: list[Any] = []
    for old in folder.glob(f"{stem}-*.webp"):
        old.unlink()
    for number, explorer in enumerate(SHOWN, 1):
        for name in dict.fromkeys(filter(None, (explorer.motion, explorer.process))):
            values, pngs, said = zip(*frames_of(explorer, name), strict=True)
            file = f"{stem}-{number}-{name}.webp"
            size = write_strip(folder / file, pngs)
            control = explorer.controls[name]
            one = {"widget": number, "file": file, "size": size, "control": control.description or name}
            one |= {"at": number_of(explorer.values[name]), "loop": name == explorer.process}
            one["named"] = [number_of(value) for value in explorer.named] if name == explorer.motion else []
            told.append(one | {"alt": explorer.alt or first_line(explorer.draw), "values": values, "said": said})
    text = json.dumps({"code": code, "widgets": told}, ensure_ascii=False, indent=1)
    (folder / f"{stem}.json").write_text(text + "\n", encoding="utf-8")


def write_strip(path: Path, pngs: Sequence[bytes]) -> tuple[int, int]:
    """Write pictures one below the other; the size of one."""
    pictures = [PIL.Image.open(io.BytesIO(png)).convert("RGB") for png in pngs]
    width, height = pictures[0].size
    strip = PIL.Image.new("RGB", (width, height * len(pictures)))
    for place, image in enumerate(pictures):
        strip.paste(image, (0, place * height))
    few = strip.quantize(48, dither=PIL.Image.Dither.NONE).convert("RGB")  # drawings: a third smaller, and as sharp
    few.save(path, lossless=True, quality=80)
    return width, height


def places(control: Any, named: Sequence[float] = (), most: int = FRAMES) -> list[Any]:
    """Most values of a slider, or all: both ends, the value that it has, what is named, and others evenly between."""
    kind, step = type(control.value), getattr(control, "step", 1)
    last = round((control.max - control.min) / step)
    wanted = {round((value - control.min) / step) for value in (control.value, *named)}
    even = min(most, last + 1)
    while len(chosen := wanted | set(np.rint(np.linspace(0, last, even)).astype(int).tolist())) > most:
        even -= 1
    return [min(control.min + kind(place * step), control.max) for place in sorted(chosen)]

"""Make one picture of several tasks from their videos: each task before, during and after its first demonstration.

.venv/bin/python scripts/contact_sheet.py gallery --task OpenSafe --task TurnOnFaucet --out docs/images/tasks.png

Or make a picture of an object library, with the first object of each class, half open.

.venv/bin/python scripts/contact_sheet.py --objects builtin --columns 7 --out docs/images/objects.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

TILE = (240, 180)
SHOWN = (20, 40, 600, 475)
"""Pixels of a film: left, top, right, bottom."""
CAPTION = 24
GAP = 8
BACKGROUND, INK = "white", "#1c2430"


def main() -> None:
    """Read the arguments and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="*", help="folders of a gallery or of runs")
    parser.add_argument("--task", dest="tasks", action="append", metavar="NAME", help="only this one, in this order")
    parser.add_argument("--objects", metavar="DIR|builtin", help="a library of objects in the place of runs")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--columns", type=int, default=2)
    options = parser.parse_args()
    if options.objects:
        objects(options.objects, options.columns, options.out)
        return
    found = {video.parent.name: video for run in options.runs for video in run.glob("tasks/*/*.mp4")}
    names = options.tasks or sorted(found)
    if not names or not set(names) <= found.keys():
        parser.error(f"no video of {', '.join(set(names) - found.keys()) or 'any task'} in these folders")
    videos = [found[name] for name in names]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    sheet([(video.parent.name, moments(video)) for video in videos], options.columns).save(options.out)
    print(f"{len(videos)} tasks in {options.out}")


def objects(where: str, columns: int, out: Path) -> None:
    """Write a picture of the first object of each class of a library."""
    from gensim2.inspection.pictures import contact_sheet
    from gensim2.objects import open_library

    library = open_library(where)
    shown = [library.load(name, library.instances(name)[0]) for name in library.classes("articulated")]
    picture = contact_sheet(shown, columns, 190)
    out.parent.mkdir(parents=True, exist_ok=True)
    picture.save(out, optimize=True)
    print(f"{len(shown)} classes in {out}")


def moments(video: Path) -> list[Image.Image]:
    """Return the first, the middle and the last frame of a video, cropped to the table."""
    frames = np.asarray(imageio.imread(video, plugin="FFMPEG"))
    return [Image.fromarray(frames[i]).crop(SHOWN).resize(TILE) for i in (0, len(frames) // 2, len(frames) - 1)]


def sheet(tasks: list[tuple[str, list[Image.Image]]], columns: int) -> Image.Image:
    """Return a picture with tasks in a grid; each task has its name and three pictures."""
    columns = min(columns, len(tasks))
    rows = -(-len(tasks) // columns)
    width = 3 * TILE[0] + 2 * GAP
    height = CAPTION + TILE[1] + GAP
    picture = Image.new("RGB", (columns * (width + 3 * GAP) - GAP, rows * height + GAP), BACKGROUND)
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(size=16)
    for index, (name, pictures) in enumerate(tasks):
        left = GAP + (index % columns) * (width + 3 * GAP)
        top = GAP + (index // columns) * height
        draw.text((left, top), name, fill=INK, font=font)
        for place, tile in enumerate(pictures):
            picture.paste(tile, (left + place * (TILE[0] + GAP), top + CAPTION))
    return picture


if __name__ == "__main__":
    main()

"""Writes the flat OpenEXR seeds of the fuzz target `deep_exr` with the reference library.

usage: python3 fuzz/flat_exr.py          (needs: pip install OpenEXR==3.5.3)

Each picture is small enough for the fuzzer, compresses with its codec, and has a block that its
codec does not fill: 7 x 33 pixels with colour, opacity and depth.
"""

import pathlib

import numpy as np
import OpenEXR

FOLDER = pathlib.Path(__file__).parent / "seeds" / "deep_exr"
CODECS = {"none": OpenEXR.NO_COMPRESSION} | {
    name: getattr(OpenEXR, f"{name.upper()}_COMPRESSION")
    for name in "rle zips zip piz pxr24 b44 b44a dwaa dwab zstd".split()
}


def picture(width, height):
    """Channels of a smooth picture: half colours and opacity, float depth."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    half = lambda v: v.astype(np.float16)
    return {
        "R": half(x / 8 + y / 64),
        "G": half(0.5 + 0.25 * np.sin(x / 3) * np.cos(y / 5)),
        "B": half(y / 32),
        "A": half(np.where(x + y > 9, 1.0, 0.5)),
        "Z": np.floor(10 + x + y / 4).astype(np.float32),
    }


def part(codec, size=(7, 33), tiles=None, name=None):
    header = {"compression": CODECS[codec], "type": OpenEXR.scanlineimage}
    if tiles:
        header |= {"type": OpenEXR.tiledimage, "tiles": tiles}
    args = {"name": name} if name else {}
    return OpenEXR.Part(header, picture(*size), **args)


def write(name, parts):
    path = FOLDER / name
    OpenEXR.File(parts).write(str(path))
    print(path.name, path.stat().st_size)


def tiles(width, height):
    t = OpenEXR.TileDescription()
    t.xSize, t.ySize, t.mode = width, height, OpenEXR.ONE_LEVEL
    return t


for codec in CODECS:
    write(f"flat-{codec}-lines", [part(codec)])
    write(f"flat-{codec}-tiles", [part(codec, (20, 12), tiles(16, 12))])
write("flat-parts", [part(c, (5, 9), name=c) for c in ("dwaa", "piz", "zips")])

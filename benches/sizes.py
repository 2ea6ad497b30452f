#!/usr/bin/env python3
"""Compares the size of a deep shadow map with that of the same content in deep OpenEXR.

  benches/sizes.py IMAGE.exr ...      prints a table and writes benches/record/sizes.md

The OpenEXR library (package `OpenEXR`) writes the channels A (half) and Z (float) of the image as
deep scanlines with ZSTD. `dsm-convert` writes the deep shadow map with its default options
(tolerance 0.01). Needs `pip install OpenEXR OpenImageIO numpy` and
`cargo build --release -p deepshadow-cli`.
"""

import os
import re
import statistics
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR
import OpenImageIO as oiio

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
TOOL = os.path.join(ROOT, "target", "release", "dsm-convert")


def deep(path):
    """The channels A and Z of a deep image: one array of samples per pixel."""
    image = oiio.ImageInput.open(path)
    spec = image.spec()
    data = image.read_native_deep_image(0, 0)
    channels = {name: spec.channelnames.index(name) for name in ("A", "Z")}
    out = {}
    for name, c in channels.items():
        kind = np.float16 if name == "A" else np.float32
        pixels = np.empty((spec.height, spec.width), dtype=object)
        for p in range(spec.width * spec.height):
            n = data.samples(p)
            values = [data.deep_value(p, c, s) for s in range(n)]
            pixels[p // spec.width, p % spec.width] = np.array(values, dtype=kind)
        out[name] = pixels
    return out


def write_exr(channels, path):
    header = {"compression": OpenEXR.ZSTD_COMPRESSION, "type": OpenEXR.deepscanline}
    OpenEXR.File(
        header, {name: OpenEXR.Channel(name, pixels) for name, pixels in channels.items()}
    ).write(path)


def convert(image, out, *options):
    run = subprocess.run(
        [TOOL, image, out, "--runstats", *options], capture_output=True, text=True, check=True
    )
    forced = re.search(r"forced steps.*\(([0-9.]+) %", run.stdout + run.stderr)
    return os.path.getsize(out), forced[1] if forced else "-"


def main():
    lines = [
        "# Sizes",
        "",
        "`benches/sizes.py` writes this table. A ratio is the size of a `.dsm` (tolerance 0.01,",
        "default options) divided by the size of the same content (A half, Z float) in deep",
        "OpenEXR with ZSTD, written in the same run by the OpenEXR library. Forced steps are",
        "larger than twice the tolerance; each must store its exact depth.",
        "",
        "| image | deep OpenEXR | base level | ratio | all levels | ratio | forced steps |",
        "|---|---|---|---|---|---|---|",
    ]
    ratios = []
    for image in sys.argv[1:] or sys.exit(__doc__):
        with tempfile.TemporaryDirectory() as folder:
            exr, dsm = os.path.join(folder, "a.exr"), os.path.join(folder, "a.dsm")
            write_exr(deep(image), exr)
            peer = os.path.getsize(exr)
            base, _ = convert(image, dsm, "--nomipmap")
            whole, forced = convert(image, dsm)
        ratios.append(base / peer)
        lines.append(
            f"| {os.path.basename(image)} | {peer:,} | {base:,} | {base / peer:.3f} "
            f"| {whole:,} | {whole / peer:.3f} | {forced} % |"
        )
    lines += ["", f"Geometric mean of the base level: {statistics.geometric_mean(ratios):.3f}.", ""]
    print("\n".join(lines))
    record = os.path.join(ROOT, "benches", "record", "sizes.md")
    notes = open(record).read().split("\n## ", 1)[1:] if os.path.exists(record) else []
    with open(record, "w") as f:
        f.write("\n".join(lines) + "".join("\n## " + n for n in notes))


main()

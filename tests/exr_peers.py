#!/usr/bin/env python3
"""Compares deepshadow-exr with the Python packages OpenEXR and OpenImageIO, value for value.

  1. The packages write deep files and our `exr_dump` reads them: all counts and bits must be equal.
  2. The same holds for flat images of every compression. With a lossy compression, our values must
     match those that the package decodes from the same file.
  3. Our `exr_copy` rewrites these deep files, and the files in --data, with every compression and
     tiling: both packages must read the same counts and bits from the copies.

Needs `pip install OpenEXR OpenImageIO numpy`; installs nothing. Exits with 1 if anything differs.

    tests/exr_peers.py [--bin-dir target/debug/examples] [--data shared/data/deep-exr] [--quick]
"""

import argparse
import glob
import json
import os
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR
import OpenImageIO as oiio

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
KINDS = {"half": np.dtype("<f2"), "float": np.dtype("<f4"), "uint": np.dtype("<u4")}
CODES = {"none": 0, "rle": 1, "zips": 2, "zstd": 13}
CONSTANT_NAMES = {"none": "NO", "rle": "RLE", "zips": "ZIPS", "zstd": "ZSTD"}
compared = {"files": 0, "parts": 0, "samples": 0, "values": 0}
failures = []


class Image:
    """A deep part: sample counts per pixel, values per channel."""

    def __init__(self, window, counts, channels):
        self.window, self.counts, self.channels = window, counts, channels


def fail(what, why):
    failures.append(f"{what}: {why}")
    print(f"FAILED     {what}: {why}")


def bits(a):
    return a.view(np.dtype(f"<u{a.dtype.itemsize}"))


def difference(want, have):
    """The first difference between two lists of images, or None."""
    if len(want) != len(have):
        return f"{len(have)} parts instead of {len(want)}"
    for index, (w, h) in enumerate(zip(want, have)):
        where = f"part {index}"
        if w.window != h.window:
            return f"{where}: window {h.window} instead of {w.window}"
        bad = np.flatnonzero(w.counts != h.counts)
        if len(bad):
            return f"{where}: pixel {bad[0]} has {h.counts[bad[0]]} samples, not {w.counts[bad[0]]}"
        if sorted(w.channels) != sorted(h.channels):
            return f"{where}: channels {sorted(h.channels)}, not {sorted(w.channels)}"
        for name, a in w.channels.items():
            b = h.channels[name]
            if len(a) != len(b) or len(a) and a.dtype != b.dtype:
                return f"{where}: {name} is {len(b)} {b.dtype}, not {len(a)} {a.dtype}"
            bad = np.flatnonzero(bits(a) != bits(b))
            if len(bad):
                return f"{where}: {name} sample {bad[0]} is {b[bad[0]]!r}, not {a[bad[0]]!r}"
            compared["values"] += len(a)
        compared["parts"] += 1
        compared["samples"] += int(w.counts.sum())
    return None


def check(what, want, read, *args, compare=difference):
    """Reads images and compares them bit for bit; a reader that fails counts as a difference."""
    compared["files"] += 1
    try:
        have = read(*args)
        why = compare(want, have)
    except Exception as e:  # the packages raise many types
        have, why = None, f"{type(e).__name__}: {e}"
    if why:
        fail(what, why)
    else:
        print(f"same       {what}")
    return have


# Readers


def read_ours(bin_dir, path, flat=False):
    run = subprocess.run([os.path.join(bin_dir, "exr_dump"), path], capture_output=True)
    if run.returncode:
        raise RuntimeError(run.stderr.decode().strip())
    head, body = run.stdout.split(b"\n", 1)
    at, images = 0, []
    for part in json.loads(head):
        x, y, w, h = part["window"]
        counts = np.frombuffer(body, "<u4", w * h, at)
        at += 4 * w * h
        channels = {}
        for name, kind in part["channels"]:
            channels[name] = np.frombuffer(body, KINDS[kind], part["samples"], at)
            at += channels[name].nbytes
        image = Image((x, y, w, h), counts, channels)
        image.header = part
        if part["deep"] != flat:
            images.append(image)
    if at != len(body):
        raise RuntimeError("bytes follow the dump")
    return images


def read_openexr(path):
    images = []
    for part in OpenEXR.File(path, separate_channels=True).parts:
        low, high = part.header["dataWindow"]
        window = (int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1))
        channels, counts = {}, None
        for name, channel in part.channels.items():
            pixels = channel.pixels.reshape(-1)
            if channel.pixels.dtype != object:
                break  # a flat part
            full = [p for p in pixels if p is not None and len(p)]
            lengths = np.array([0 if p is None else len(p) for p in pixels], "<u4")
            if counts is not None and (counts != lengths).any():
                raise RuntimeError("channels with different counts")
            counts = lengths
            # The module reports no type for channels without samples.
            values = np.concatenate(full) if full else np.zeros(0, "<u1")
            if full and values.dtype not in KINDS.values():
                raise RuntimeError(f"{name} is {values.dtype}")
            channels[name] = values
        if counts is not None:
            images.append(Image(window, counts, channels))
    return images


def read_oiio(path):
    reader = oiio.ImageInput.open(path)
    if reader is None:
        raise RuntimeError(oiio.geterror())
    images, index = [], 0
    while reader.seek_subimage(index, 0):
        spec = reader.spec()
        index += 1
        if not spec.deep:
            continue
        deep = reader.read_native_deep_image(index - 1, 0)
        if deep is None:
            raise RuntimeError(reader.geterror())
        pixels = spec.width * spec.height
        counts = np.array([deep.samples(p) for p in range(pixels)], "<u4")
        full = [(p, range(n)) for p, n in enumerate(counts.tolist()) if n]
        channels = {}
        for c, name in enumerate(spec.channelnames):
            kind = {"half": "half", "float": "float", "uint": "uint", "uint32": "uint"}[
                str(deep.channeltype(c))
            ]
            get = deep.deep_value_uint if kind == "uint" else deep.deep_value
            wide = np.array(
                [get(p, c, s) for p, n in full for s in n], "<u4" if kind == "uint" else "<f4"
            )
            channels[name] = wide.astype(KINDS[kind])
        images.append(Image((spec.x, spec.y, spec.width, spec.height), counts, channels))
    reader.close()
    return images


def read_oiio_flat(path):
    reader = oiio.ImageInput.open(path)
    if reader is None:
        raise RuntimeError(oiio.geterror())
    spec, channels = reader.spec(), {}
    formats = spec.channelformats or (spec.format,) * spec.nchannels
    for c, name in enumerate(spec.channelnames):
        values = reader.read_image(0, 0, c, c + 1, "float").reshape(-1)
        channels[name] = values.astype(
            KINDS[{"uint32": "uint"}.get(str(formats[c]), str(formats[c]))]
        )
    reader.close()
    window = (spec.x, spec.y, spec.width, spec.height)
    return [Image(window, np.ones(spec.width * spec.height, "<u4"), channels)]


def close(want, have):
    """Like `difference`, with a tolerance for the rounding of two decoders of one lossy codec."""
    for w, h in zip(want, have):
        for name, a in w.channels.items():
            b = h.channels[name].astype("f8")
            far = np.flatnonzero(np.abs(a - b) > 2e-3 * np.abs(a) + 1e-5)
            if len(far):
                return f"{name} sample {far[0]} is {b[far[0]]!r}, not {a[far[0]]!r}"
            h.channels[name] = a
    return difference(want, have)


# Test images and the packages' writers


def make(window, kinds, seed, most=6):
    """A random image: pixels of 0 to `most` samples, one of 50, and one empty row."""
    random = np.random.default_rng(seed)
    _, _, w, h = window
    counts = np.where(random.random(w * h) < 0.4, 0, random.integers(0, most + 1, w * h)).astype(
        "<u4"
    )
    counts.reshape(h, w)[h // 2] = 0
    counts[-1] = 50
    n = int(counts.sum())
    channels = {}
    for name, kind in kinds.items():
        if kind == "uint":
            channels[name] = random.integers(0, 2**32, n, "<u4")
        else:
            channels[name] = (np.round(random.random(n) * 640) / 80).astype(KINDS[kind])
    return Image(window, counts, channels)


def write_openexr(path, images, compression, tiles, order=None):
    parts = []
    for index, image in enumerate(images):
        x, y, w, h = image.window
        ends = np.cumsum(image.counts)
        channels = {}
        for name, values in image.channels.items():
            pixels = np.empty(w * h, object)
            for p, (end, n) in enumerate(zip(ends, image.counts)):
                pixels[p] = np.ascontiguousarray(values[end - n : end]) if n else None
            channels[name] = OpenEXR.Channel(name, pixels.reshape(h, w))
        header = {
            "type": OpenEXR.deeptile if tiles else OpenEXR.deepscanline,
            "compression": getattr(OpenEXR, CONSTANT_NAMES[compression] + "_COMPRESSION"),
            "dataWindow": (np.array([x, y], "i4"), np.array([x + w - 1, y + h - 1], "i4")),
            "displayWindow": (np.array([0, 0], "i4"), np.array([99, 99], "i4")),
        }
        if order is not None:
            header["lineOrder"] = order
        if tiles:
            header["tiles"] = OpenEXR.TileDescription()
            header["tiles"].xSize, header["tiles"].ySize = tiles
            header["tiles"].mode = OpenEXR.ONE_LEVEL
        parts.append(OpenEXR.Part(header, channels, f"part{index}" if len(images) > 1 else ""))
    OpenEXR.File(parts).write(path)


def write_oiio(path, image, compression, tiles):
    x, y, w, h = image.window
    names = sorted(image.channels)
    kind = {"<f2": "half", "<f4": "float", "<u4": "uint"}
    formats = tuple(oiio.TypeDesc(kind[image.channels[n].dtype.str]) for n in names)
    spec = oiio.ImageSpec(w, h, len(names), "float")
    spec.x, spec.y, spec.deep = x, y, True
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 100, 100
    spec.channelnames, spec.channelformats = tuple(names), formats
    spec.attribute("compression", compression)
    if tiles:
        spec.tile_width, spec.tile_height = tiles
    deep = oiio.DeepData()
    deep.init(w * h, len(names), formats, tuple(names))
    for p, n in enumerate(image.counts.tolist()):
        deep.set_samples(p, n)
    at = 0
    for p, n in enumerate(image.counts.tolist()):
        for s in range(n):
            for c, name in enumerate(names):
                value = image.channels[name][at + s]
                if image.channels[name].dtype == KINDS["uint"]:
                    deep.set_deep_value_uint(p, c, s, int(value))
                else:
                    deep.set_deep_value(p, c, s, float(value))
        at += n
    out = oiio.ImageOutput.create(path)
    if out is None or not out.open(path, spec) or not out.write_deep_image(deep):
        raise RuntimeError(out.geterror() if out else oiio.geterror())
    out.close()


def write_flat(path, compression, tiles, mipmaps):
    """Writes a flat image with a smooth Z and a noisy A."""
    w, h = 150, 70
    yy, xx = np.mgrid[0:h, 0:w]
    pixels = np.zeros((h, w, 2), "f4")
    pixels[..., 0] = np.random.default_rng(9).random((h, w))
    pixels[..., 1] = 10 + np.sin(xx / 20) * np.cos(yy / 9)
    spec = oiio.ImageSpec(w, h, 2, "float")
    spec.channelnames, spec.channelformats = (
        ("A", "Z"),
        (oiio.TypeDesc("half"), oiio.TypeDesc("float")),
    )
    if not mipmaps:
        spec.x, spec.y = -3, 5
    spec.attribute("compression", compression)
    if tiles:
        spec.tile_width, spec.tile_height = tiles
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(oiio.ROI(spec.x, spec.x + w, spec.y, spec.y + h, 0, 1, 0, 2), pixels)
    if mipmaps:
        config = oiio.ImageSpec()
        config.attribute("compression", compression)
        done = oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, buffer, path, config)
    else:
        done = buffer.write(path)
    if not done:
        raise RuntimeError(buffer.geterror() or oiio.geterror())


def written(what, write, *args):
    """Whether a package wrote a file; records a failure if it did not."""
    try:
        write(*args)
        return True
    except Exception as e:  # the packages raise many types
        fail(what, f"{type(e).__name__}: {e}")
        return False


def main():
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "--bin-dir", help="folder of exr_dump and exr_copy; they are built if not given"
    )
    options.add_argument("--data", default=os.path.join(ROOT, "..", "shared", "data", "deep-exr"))
    options.add_argument("--quick", action="store_true", help="make fewer copies of large files")
    options = options.parse_args()
    bin_dir = options.bin_dir
    if not bin_dir:
        subprocess.run(
            ["cargo", "build", "-q", "-p", "deepshadow-exr", "--examples"], cwd=ROOT, check=True
        )
        target = os.environ.get("CARGO_TARGET_DIR", os.path.join(ROOT, "target"))
        bin_dir = os.path.join(target, "debug", "examples")
    print(f"OpenEXR {OpenEXR.__version__}, OpenImageIO {oiio.__version__}")

    # The comparison must detect a single changed bit.
    one, other = (make((0, 0, 4, 4), {"Z": "float"}, 1) for _ in range(2))
    assert difference([one], [other]) is None
    bits(other.channels["Z"])[7] ^= 1
    assert difference([one], [other]) is not None
    compared.update(dict.fromkeys(compared, 0))

    folder = tempfile.TemporaryDirectory()
    path = lambda name: os.path.join(folder.name, name)
    originals = []  # (path, images)
    unreadable_by_openexr = set()

    kinds = {
        "az": {"A": "half", "Z": "float"},
        "back": {
            "A": "half",
            "AB": "half",
            "AG": "half",
            "AR": "half",
            "Z": "float",
            "ZBack": "float",
        },
        "mixed": {"A": "float", "B": "half", "Z": "half", "id": "uint", "z": "half"},
        "z": {"Z": "float"},
    }
    for name, channels in kinds.items():
        image = make((-5, 3, 23, 17), channels, len(originals))
        for compression, code in CODES.items():
            for tiles in (None, (8, 4), (32, 32)):
                tiling = f"{tiles[0]}x{tiles[1]}" if tiles else "lines"
                for package, write, data in (
                    ("OpenEXR", write_openexr, [image]),
                    ("OpenImageIO", write_oiio, image),
                ):
                    what = f"{package} writes {name} {compression} {tiling}"
                    file = path(f"{package}-{name}-{compression}-{tiling}.exr")
                    if not written(what, write, file, data, compression, tiles):
                        continue
                    have = check(f"{what}, we read", [image], read_ours, bin_dir, file)
                    if have and have[0].header["compression"] != code:
                        if package == "OpenEXR":
                            fail(what, f"compression is {have[0].header['compression']}")
                        else:
                            print(f"note       {what}: it used another compression")
                if compression == "zips":
                    originals.append((path(f"OpenEXR-{name}-{compression}-{tiling}.exr"), [image]))

    image = make((0, 0, 20, 20), kinds["back"], 50)
    if written(
        "OpenEXR writes upwards",
        write_openexr,
        path("up.exr"),
        [image],
        "zips",
        None,
        OpenEXR.DECREASING_Y,
    ):
        check("OpenEXR writes upwards, we read", [image], read_ours, bin_dir, path("up.exr"))

    several = [make((0, 0, 9, 9), kinds["az"], 60), make((-9, 2, 30, 4), kinds["mixed"], 61)]
    for compression in CODES:
        for tiles in (None, (8, 4)):
            what = f"OpenEXR writes two parts {compression} {'tiles' if tiles else 'lines'}"
            file = path(f"two-{compression}-{bool(tiles)}.exr")
            if written(what, write_openexr, file, several, compression, tiles):
                check(f"{what}, we read", several, read_ours, bin_dir, file)
                if compression == "zips":
                    originals.append((file, several))

    flat = ["none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"]
    for compression in flat:
        for tiles, mipmaps in ((None, False), ((32, 16), False), ((64, 64), True)):
            layout = "mipmaps" if mipmaps else "tiles" if tiles else "lines"
            what = f"OpenImageIO writes flat {compression} {layout}"
            file = path(f"flat-{compression}-{bool(tiles)}-{mipmaps}.exr")
            if written(what, write_flat, file, compression, tiles, mipmaps):
                compare = close if compression.startswith("dwa") else difference
                check(
                    f"{what}, we read",
                    read_oiio_flat(file),
                    read_ours,
                    bin_dir,
                    file,
                    True,
                    compare=compare,
                )
    random = np.random.default_rng(4)
    smooth = np.cumsum(random.random((33, 20)), axis=1).astype("f4")
    for compression in ("ZSTD", "PIZ", "ZIP"):
        header = {
            "compression": getattr(OpenEXR, compression + "_COMPRESSION"),
            "type": OpenEXR.scanlineimage,
        }
        planes = {"A": smooth.astype("f2") / 20, "Z": smooth, "id": (smooth * 9).astype("u4")}
        OpenEXR.File(header, dict(planes)).write(path("plain.exr"))
        want = Image(
            (0, 0, 20, 33), np.ones(660, "<u4"), {n: p.reshape(-1) for n, p in planes.items()}
        )
        check(
            f"OpenEXR writes flat {compression}, we read",
            [want],
            read_ours,
            bin_dir,
            path("plain.exr"),
            True,
        )

    # Noise compresses badly; the image spans several blocks of every kind.
    noise = make((0, 0, 70, 40), kinds["mixed"], 70, 30)
    if written("OpenEXR writes noise", write_openexr, path("noise.exr"), [noise], "zips", None):
        originals.append((path("noise.exr"), [noise]))

    others = [f for f in sorted(glob.glob(os.path.join(options.data, "*.exr"))) if "_FLAT" not in f]
    if not others:
        print(f"skipped: no files in {options.data}")
    for file in others:
        what = os.path.basename(file)
        package = "OpenEXR"
        try:
            want = read_openexr(file)
        except (RuntimeError, UnicodeDecodeError) as e:
            # The Python module does not support some attributes: use OpenImageIO instead.
            print(f"note       {what}: OpenEXR cannot read it: {e}")
            unreadable_by_openexr.add(file)
            package, want = "OpenImageIO", read_oiio(file)
        check(f"{what}: {package} and we read", want, read_ours, bin_dir, file)
        originals.append((file, want))

    for file, images in originals:
        readers = [
            ("OpenEXR", read_openexr),
            ("OpenImageIO", read_oiio),
            ("deepshadow-exr", lambda f: read_ours(bin_dir, f)),
        ]
        if file in unreadable_by_openexr:
            del readers[0]
        large = sum(int(i.counts.sum()) * len(i.channels) for i in images) > 100_000
        for compression in CODES:
            for tiling in ("scanline", "16x8", "64x64"):
                if large and (
                    tiling == "16x8" or options.quick and compression not in ("zips", "zstd")
                ):
                    continue
                copy = path("copy.exr")
                what = f"our copy of {os.path.basename(file)} {compression} {tiling}"
                command = [os.path.join(bin_dir, "exr_copy"), file, copy, compression, tiling]
                run = subprocess.run(command, capture_output=True)
                if run.returncode:
                    fail(what, run.stderr.decode().strip())
                    continue
                for reader, function in readers:
                    check(f"{what}, read by {reader}", images, function, copy)

    print(
        f"{compared['files']} comparisons of {compared['parts']} parts, "
        f"{compared['samples']} samples, "
        f"{compared['values']} values: {len(failures)} failures"
    )
    for failure in failures:
        print(f"  {failure}")
    return 1 if failures or not compared["values"] else 0


if __name__ == "__main__":
    sys.exit(main())

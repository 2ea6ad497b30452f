#!/usr/bin/env python3
"""Tests reader.py with an independent writer, written from format.md alone.

Run with: python3 spec/test_reader.py

The writer passes every record to `edit(stage, value)` before it computes checksums, and writes the
result. A test can therefore break one thing in an otherwise valid file.
"""

import contextlib
import hashlib
import io
import math
import os
import pathlib
import random
import re
import struct
import sys
import tempfile
import unittest
import zlib
from fractions import Fraction

sys.dont_write_bytecode = True
import reader  # noqa: E402

try:
    import lz4.block as lz4_block
except ImportError:
    lz4_block = None

CODECS = [0] + ([1] if lz4_block else []) + ([2] if reader.zstandard else [])
MAGIC = b"\x89DSM\r\n\x1a\n"


# ---- The writer ----------------------------------------------------------------------------------
#
# A map is a dict with the keys of `a_map` below. A level is a dict with max_error and pixels.
# Pixels are {(x, y): (channels, depths, stored)}; `stored` holds k on a lattice and f32 otherwise,
# with the channels of a vertex adjacent.


def no_edit(_stage, value):
    return value


def planes(values, width):
    data = b"".join(v.to_bytes(width, "little") for v in values)
    return b"".join(data[i::width] for i in range(width))


def bitstring(bits):
    return sum(bit << i for i, bit in enumerate(bits)).to_bytes((len(bits) + 7) // 8, "little")


def f32_bits(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


def ordered(depth):
    bits = f32_bits(depth)
    return ~bits & 0xFFFFFFFF if bits >> 31 else bits ^ 0x80000000


def encode(data, codec):
    if codec == 1:
        return lz4_block.compress(data, store_size=False)
    if codec == 2:
        return reader.zstandard.ZstdCompressor(level=3).compress(data)
    return data


def padded(data):
    return data + bytes(-len(data) % 8)


def plain(functions, lattice, coloured):
    table, colour = [0], [0]
    for channels, depths, _ in functions:
        table.append(table[-1] + len(depths))
        colour.append(colour[-1] + (len(depths) if channels == 3 else 0))
    out = struct.pack(f"<{len(table)}I", *table)
    if coloured:
        out += struct.pack(f"<{len(colour)}I", *colour)
    for _, depths, _ in functions:
        out += struct.pack(f"<{len(depths)}f", *depths)
    for channel in range(3 if coloured else 1):
        for channels, _, stored in functions:
            if channel < channels:
                values = stored[channel::channels]
                out += struct.pack(f"<{len(values)}{'H' if lattice else 'f'}", *values)
    return padded(out)


def delta(functions, lattice, coloured, width):
    counts = [len(depths) for _, depths, _ in functions]
    out = planes(counts, 4)
    if coloured:
        out += bitstring([int(channels == 3) for channels, _, _ in functions])
    steps, firsts, gaps, last = [], [], [], 0x80000000
    for i, (_, depths, _) in enumerate(functions):
        if not depths:
            continue
        order = [ordered(z) for z in depths]

        def neighbour(dx, dy):
            x, y = i % width - dx, i // width - dy
            there = x >= 0 and y >= 0 and counts[y * width + x]
            return ordered(functions[y * width + x][1][0]) if there else None

        left, up, both = neighbour(1, 0), neighbour(0, 1), neighbour(1, 1)
        if None not in (left, up, both):
            guess = left + up - both
        else:
            guess = next(g for g in (left, up, last) if g is not None)
        d = (order[0] - guess) % 2**32
        d -= 2**32 if d >= 2**31 else 0
        firsts.append((d << 1 ^ d >> 31) % 2**32)
        last = order[0]
        for a, b in zip(order, order[1:]):
            steps.append(int(a == b))
            if a != b:
                gaps.append((b - a) % 2**32)
    out += bitstring(steps) + planes(firsts, 4) + planes(gaps, 4)
    for channel in range(3 if coloured else 1):
        drops = []
        for channels, _, stored in functions:
            before = lattice or f32_bits(1.0)
            for value in stored[channel::channels] if channel < channels else []:
                value = value if lattice else f32_bits(value)
                drops.append((before - value) % (2**16 if lattice else 2**32))
                before = value
        out += planes(drops, 2 if lattice else 4)
    return out


def nearest_f32(value):
    """The f32 nearest to a Fraction from 0 to 1, found by comparing neighbouring f32."""
    bits = f32_bits(float(value))
    around = [
        struct.unpack("<f", struct.pack("<I", b))[0] for b in (max(bits - 1, 0), bits, bits + 1)
    ]
    return min(around, key=lambda f: (abs(Fraction(f) - value), f32_bits(f) & 1))


def visible(k, lattice):
    return nearest_f32(Fraction(k, lattice)) if lattice else k


class Writer:
    def __init__(self, edit=no_edit):
        self.edit, self.out = edit, bytearray(64)

    def tile(self, functions, m, width):
        """Writes the payload and returns the entry."""
        ends = [
            visible(v, m["lattice"])
            for c, z, s in functions
            for v in (s[-c:] or [m["lattice"] or 1.0])
        ]
        depths = [z for _, zs, _ in functions for z in zs]
        f = dict(
            offset=0,
            stored_size=0,
            decoded_size=0,
            vertices=0,
            crc=0,
            z_min=0.0,
            z_max=0.0,
            end_min=1.0,
            end_max=1.0,
            kind=0,
            codec=0,
            transform=0,
            padding=0,
            lattice=0,
            flags=0,
        )
        if not depths:
            return self.edit("entry", f)
        f.update(
            vertices=len(depths),
            z_min=min(depths),
            z_max=max(depths),
            end_min=min(ends),
            end_max=max(ends),
        )
        if (
            all(function == functions[0] for function in functions)
            and len(functions[0][1]) == 1 == functions[0][0]
        ):
            f.update(kind=1)
            return self.edit("entry", f)
        coloured = any(channels == 3 for channels, _, _ in functions)
        decoded = (
            delta(functions, m["lattice"], coloured, width)
            if m["transform"]
            else plain(functions, m["lattice"], coloured)
        )
        decoded = self.edit("decoded", decoded)
        stored = self.edit("encoded", encode(decoded, m["codec"]))
        f.update(
            kind=2,
            offset=len(self.out),
            stored_size=len(padded(stored)),
            decoded_size=len(decoded),
            padding=-len(stored) % 8,
            codec=m["codec"],
            transform=m["transform"],
            lattice=m["lattice"],
            flags=int(coloured),
        )
        stored = self.edit("stored", padded(stored))
        f.update(crc=zlib.crc32(stored))
        self.out += stored
        return self.edit("entry", f)

    def level(self, m, index):
        """Writes the payloads and returns the entries."""
        size, pixels = 1 << m["tile_log2"], m["levels"][index]["pixels"]
        width, height = (math.ceil(m[s] / 2**index) for s in ("width", "height"))
        entries = []
        for y in range(0, height, size):
            for x in range(0, width, size):
                wide, high = min(size, width - x), min(size, height - y)
                functions = [
                    pixels.get((x + i, y + j), (1, [], []))
                    for j in range(high)
                    for i in range(wide)
                ]
                entries.append(self.tile(functions, m, wide))
        return entries

    def blocks(self, m, index, entries):
        level = m["levels"][index]
        f = self.edit(
            "level",
            dict(
                max_error=level["max_error"],
                vertices=sum(e["vertices"] for e in entries),
                payload_bytes=sum(e["stored_size"] for e in entries),
            ),
        )
        out = struct.pack("<dQQ", *f.values())
        for b in range(0, len(entries), 1024):
            data = b"".join(
                struct.pack("<QIIIIffffBBBBHH", *e.values()) for e in entries[b : b + 1024]
            )
            codec = m["block_codec"]
            data = self.edit("entries", data)
            if codec:
                data = b"".join(data[i::48] for i in range(48))
            data = self.edit("block data", encode(data, codec))
            f = dict(
                offset=len(self.out),
                stored_size=len(padded(data)),
                crc=0,
                codec=codec,
                padding=-len(data) % 8,
                reserved=bytes(6),
            )
            data = self.edit("block stored", padded(data))
            f = self.edit("block", dict(f, crc=zlib.crc32(data)))
            self.out += data
            out += struct.pack("<QIIBB6s", *f.values())
        return out

    def name(self, text):
        data = text if isinstance(text, bytes) else text.encode()
        return struct.pack("<H", len(data)) + data

    def attributes(self, attributes):
        return b"".join(
            self.name(n) + struct.pack("<BI", kind, len(v)) + v for n, kind, v in attributes
        )

    def map(self, m, levels):
        to_camera, to_ndc = m["camera"]
        f = dict(
            width=m["width"],
            height=m["height"],
            channels=m["channels"],
            tile_log2=m["tile_log2"],
            level_count=len(m["levels"]),
            depth_kind=m["depth_kind"],
            interpretation=m["interpretation"],
            camera_flags=bool(to_camera) + 2 * bool(to_ndc),
            reserved=bytes(2),
            unit=m["unit"],
            x=m["origin"][0],
            y=m["origin"][1],
            x0=m["window"][0],
            y0=m["window"][1],
            x1=m["window"][2],
            y1=m["window"][3],
            attribute_count=len(m["attributes"]),
        )
        f = self.edit("map", f)
        out = self.name(m["name"]) + struct.pack("<IIBBBBBB2sd2i4iI", *f.values())
        for matrix in (to_camera, to_ndc):
            out += struct.pack("<16d", *matrix) if matrix else b""
        return out + b"".join(levels) + self.attributes(m["attributes"])

    def write(self, file):
        edit = self.edit
        header = edit("header", struct.pack("<8sHH48s", MAGIC, 1, 64, bytes(48)))
        self.out[:64] = header + struct.pack("<I", zlib.crc32(header))
        entries = [[self.level(m, i) for i in range(len(m["levels"]))] for m in file["maps"]]
        edit("after tiles", self.out)
        directory = len(self.out)
        levels = [
            [self.blocks(m, i, e) for i, e in enumerate(es)] for m, es in zip(file["maps"], entries)
        ]
        edit("after blocks", self.out)
        f = edit(
            "footer",
            dict(
                required=0,
                optional=file["optional"],
                maps=len(file["maps"]),
                groups=len(file["groups"]),
                attributes=len(file["attributes"]),
                reserved=bytes(4),
            ),
        )
        footer = struct.pack("<QQIII4s", *f.values()) + b"".join(
            self.map(m, ls) for m, ls in zip(file["maps"], levels)
        )
        for group_name, role, maps in file["groups"]:
            footer += self.name(group_name) + struct.pack(
                f"<BI{len(maps)}I", role, len(maps), *maps
            )
        footer = edit("footer bytes", padded(footer + self.attributes(file["attributes"])))
        f = dict(
            file_length=len(self.out) + len(footer) + 64,
            directory=directory,
            footer=len(self.out),
            footer_size=len(footer),
            footer_crc=zlib.crc32(footer),
            version=1,
            reserved=bytes(14),
            mark=b"DSM-END\n",
        )
        trailer = edit("trailer bytes", struct.pack("<QQQQIH14s8s", *edit("trailer", f).values()))
        self.out += footer + trailer + struct.pack("<I", zlib.crc32(trailer))
        return bytes(self.out)


# ---- Test files ----------------------------------------------------------------------------------


def a_map(**changes):
    m = dict(
        name="sun",
        width=5,
        height=7,
        channels=1,
        tile_log2=3,
        depth_kind=1,
        interpretation=1,
        camera=(None, None),
        unit=0.0,
        origin=(0, 0),
        window=(0, 0, 4, 6),
        attributes=[],
        lattice=0,
        codec=0,
        block_codec=0,
        transform=0,
        levels=[dict(max_error=0.01, pixels={(3, 2): (1, [1.5, 2.0, 2.0], [0.75, 0.5, 0.25])})],
    )
    return dict(m, **changes)


def a_file(*maps, **changes):
    return dict(dict(maps=maps, groups=[], attributes=[], optional=0), **changes)


def one_pixel(depths, stored, channels=1, **changes):
    return a_file(
        a_map(
            channels=3,
            levels=[dict(max_error=0.0, pixels={(3, 2): (channels, depths, stored)})],
            **changes,
        )
    )


def random_function(rng, lattice, colour):
    """A random function that obeys the laws.

    Visibility stays constant only between two vertices in front of a fall; the first depth has no
    step.
    """
    channels = 3 if colour and rng.random() < 0.5 else 1
    count = rng.randrange(1, 12)
    depths = sorted(
        {
            struct.unpack(
                "<f",
                struct.pack("<f", rng.choice([rng.uniform(-5, 5), rng.gauss(0, 1e30), 0.0, 1e-45])),
            )[0]
            for _ in range(count)
        }
    )
    depths = [
        z + 0.0 for i, z in enumerate(depths) for _ in range(1 + (i > 0 and rng.random() < 0.4))
    ]
    one = lattice or 1.0
    rows, stayed = [[one] * channels], True
    for i in range(len(depths)):
        step, last = i > 0 and depths[i] == depths[i - 1], i + 1 == len(depths)
        before = rows[-1]
        if not step and not last and rng.random() < 0.2 and (i == 0 or not stayed):
            rows.append(list(before))
            stayed = True
            continue
        falls = [
            1 + rng.randrange(max(1, lattice // 40)) if lattice else rng.uniform(0.001, 0.05)
            for _ in range(channels)
        ]
        if channels == 3 and rng.random() < 0.3:
            falls[rng.randrange(3)] = 0
        row = [max(0, v - fall) for v, fall in zip(before, falls)]
        row = row if lattice else [struct.unpack("<f", struct.pack("<f", v))[0] for v in row]
        if row == before:
            break
        rows.append(row)
        stayed = False
    rows = rows[1:]
    while rows and (rows[-1] == (rows[-2] if len(rows) > 1 else [one] * channels)):
        rows.pop()
    if channels == 3 and all(len(set(row)) == 1 for row in rows):
        rows, channels = [row[:1] for row in rows], 1
    return channels, depths[: len(rows)], [v for row in rows for v in row]


def random_level(rng, m, index, max_error):
    width, height = (math.ceil(m[s] / 2**index) for s in ("width", "height"))
    full = rng.random()
    pixels = {
        (x, y): random_function(rng, m["lattice"], m["channels"] == 3)
        for y in range(height)
        for x in range(width)
        if rng.random() < full
    }
    if rng.random() < 0.3:  # a constant tile, unless it is clipped
        k = m["lattice"] // 2 if m["lattice"] else 0.5
        pixels.update(
            {(x, y): (1, [2.5], [k]) for y in range(min(8, height)) for x in range(min(8, width))}
        )
    return dict(max_error=max_error, pixels={at: f for at, f in pixels.items() if f[1]})


def random_map(rng, name, **changes):
    m = a_map(
        name=name,
        width=rng.randrange(1, 30),
        height=rng.randrange(1, 30),
        channels=rng.choice([1, 3]),
        tile_log2=rng.choice([3, 4]),
        codec=rng.choice(CODECS),
        block_codec=rng.choice(CODECS),
        transform=rng.randrange(2),
        lattice=rng.choice([0, 0, 255, 1000, 65535]),
        depth_kind=rng.randrange(3),
        interpretation=rng.randrange(3),
        unit=rng.choice([0.0, 1.0, 0.01]),
        origin=(-3, 4),
        window=(-10, -10, 20, 10),
    )
    m.update(
        camera=(
            rng.choice([None, tuple(map(float, range(16)))]),
            rng.choice([None, tuple(-i / 3 for i in range(16))]),
        )
    )
    m.update(changes)
    top = 1 + math.ceil(math.log2(max(m["width"], m["height"])))
    m["levels"] = [random_level(rng, m, i, i / 10) for i in range(rng.randrange(1, top + 1))]
    return m


def model_hash(file):
    """The content hash of section 10, computed pixel by pixel."""
    out = bytearray(b"DSM-CONTENT-1\0\0\0" + struct.pack("<I", len(file["maps"])))
    for m in file["maps"]:
        name = m["name"].encode()
        out += struct.pack("<H", len(name)) + name + struct.pack("<II", m["width"], m["height"])
        out += (
            struct.pack("<Bd", m["depth_kind"], m["unit"])
            + struct.pack("<2i", *m["origin"])
            + struct.pack("<4i", *m["window"])
        )
        out += bytes([bool(m["camera"][0]) + 2 * bool(m["camera"][1])])
        out += b"".join(struct.pack("<16d", *matrix) for matrix in m["camera"] if matrix) + bytes(
            [len(m["levels"])]
        )
        for i, level in enumerate(m["levels"]):
            out += struct.pack("<d", level["max_error"])
            for y in range(math.ceil(m["height"] / 2**i)):
                for x in range(math.ceil(m["width"] / 2**i)):
                    channels, depths, stored = level["pixels"].get((x, y), (1, [], []))
                    out += struct.pack("<IB", len(depths), channels) + struct.pack(
                        f"<{len(depths)}f", *depths
                    )
                    out += b"".join(struct.pack("<f", visible(v, m["lattice"])) for v in stored)
    out += struct.pack("<I", len(file["groups"]))
    for name, role, maps in file["groups"]:
        out += (
            struct.pack("<H", len(name.encode()))
            + name.encode()
            + struct.pack(f"<BI{len(maps)}I", role, len(maps), *maps)
        )
    return hashlib.sha256(out).hexdigest()


# ---- One invalid file per rule -------------------------------------------------------------------


def put(stage, **fields):
    """An edit that sets fields of every record of a stage; values may be functions of it."""

    def edit(s, value):
        return (
            dict(value, **{k: f(value) if callable(f) else f for k, f in fields.items()})
            if s == stage
            else value
        )

    return edit


def change(stage, function):
    return lambda s, value: function(value) if s == stage else value


def at(position, data):
    return lambda value: value[:position] + data + value[position + len(data) :]


def grow(value):
    value += bytes(8)


PLAIN = a_file(a_map())
LATTICE = one_pixel([1.0], [9], lattice=10)
DELTA = a_file(a_map(transform=1))
COLOUR = one_pixel([1.0, 2.0], [1.0, 0.5, 0.5, 0.0, 0.5, 0.5], 3)
EMPTY = a_file(a_map(levels=[dict(max_error=0.0, pixels={})]))
CONSTANT = a_file(
    a_map(
        levels=[
            dict(
                max_error=0.0,
                pixels={(x, y): (1, [2.0], [0.5]) for x in range(5) for y in range(7)},
            )
        ]
    )
)
TWO_TILES = a_file(
    a_map(
        width=16, levels=[dict(max_error=0.0, pixels={(x, 0): (1, [2.0], [0.5]) for x in (0, 8)})]
    )
)
NAN, INF = math.nan, math.inf


def overlap():
    """An edit that makes the second tile refer to the payload of the first."""
    seen = []

    def edit(stage, value):
        if stage == "entry":
            seen.append(value["offset"])
            return dict(value, offset=seen[0])
        return value

    return edit


def named(*names):
    return a_file(*(a_map(name=n) for n in names))


def grouped(*groups):
    return a_file(a_map(), a_map(name="b"), groups=list(groups))


def attributed(*attributes):
    return a_file(a_map(attributes=list(attributes)))


BROKEN = [  # rule, file, edit
    ("HEADER-MAGIC", PLAIN, change("header", at(0, b"X"))),
    ("HEADER-SIZE", PLAIN, change("header", at(10, b"\x41"))),
    ("HEADER-RESERVED", PLAIN, change("header", at(59, b"\1"))),
    ("TRAILER-COMMIT", PLAIN, put("trailer", mark=b"DSM-END\r")),
    ("TRAILER-VERSION", PLAIN, put("trailer", version=2)),
    ("TRAILER-RESERVED", PLAIN, put("trailer", reserved=b"\1".rjust(14, b"\0"))),
    ("FILE-LENGTH", PLAIN, put("trailer", file_length=lambda f: f["file_length"] + 8)),
    ("FOOTER-RANGE", PLAIN, put("trailer", footer=lambda f: f["footer"] - 8)),
    ("FOOTER-RANGE", PLAIN, put("trailer", footer=2**64 - 8, footer_size=8)),
    ("FOOTER-RANGE", PLAIN, change("footer bytes", lambda b: b + bytes(4))),
    ("DIRECTORY-RANGE", PLAIN, put("trailer", directory=lambda f: f["directory"] + 4)),
    ("DIRECTORY-RANGE", PLAIN, put("trailer", directory=56)),
    ("DIRECTORY-RANGE", PLAIN, put("trailer", directory=lambda f: f["footer"] + 8)),
    ("FOOTER-CRC", PLAIN, put("trailer", footer_crc=lambda f: f["footer_crc"] ^ 1)),
    ("FOOTER-SHORT", PLAIN, change("footer bytes", lambda b: b[:-16])),
    ("FOOTER-SHORT", PLAIN, change("footer bytes", lambda b: b"")),
    ("FOOTER-PADDING", PLAIN, change("footer bytes", lambda b: b + bytes(8))),
    (
        "FOOTER-PADDING",
        a_file(a_map(name="abcd")),
        change("footer bytes", lambda b: b[:-1] + b"\1"),
    ),
    ("FOOTER-RESERVED", PLAIN, put("footer", reserved=b"\0\0\0\1")),
    ("MAP-COUNT", PLAIN, put("footer", maps=0)),
    ("MAP-COUNT", PLAIN, put("footer", maps=65537)),
    ("GROUP-COUNT", PLAIN, put("footer", groups=65537)),
    ("ATTRIBUTE-COUNT", PLAIN, put("footer", attributes=65537)),
    ("ATTRIBUTE-COUNT", PLAIN, put("map", attribute_count=2**32 - 1)),
    ("MAP-NAME", named("a", "a"), no_edit),
    ("MAP-NAME", named(""), no_edit),
    ("MAP-NAME", named("x" * 256), no_edit),
    ("MAP-NAME", named(b"\xff"), no_edit),
    ("MAP-NAME", named(b"\xed\xa0\x80"), no_edit),
    ("MAP-NAME", named("a\nb"), no_edit),
    ("MAP-SIZE", PLAIN, put("map", width=0)),
    ("MAP-SIZE", PLAIN, put("map", height=2**20 + 1)),
    ("MAP-CHANNELS", PLAIN, put("map", channels=2)),
    ("MAP-CHANNELS", COLOUR, put("map", channels=1)),
    ("MAP-TILE", PLAIN, put("map", tile_log2=2)),
    ("MAP-TILE", PLAIN, put("map", tile_log2=9)),
    ("MAP-LEVELS", PLAIN, put("map", level_count=0)),
    ("MAP-LEVELS", PLAIN, put("map", level_count=5)),
    ("MAP-DEPTH", PLAIN, put("map", depth_kind=3)),
    ("MAP-INTERPRETATION", PLAIN, put("map", interpretation=3)),
    ("MAP-CAMERA", PLAIN, put("map", camera_flags=4)),
    ("MAP-CAMERA", a_file(a_map(camera=((NAN,) * 16, None))), no_edit),
    ("MAP-RESERVED", PLAIN, put("map", reserved=b"\0\1")),
    ("MAP-UNIT", PLAIN, put("map", unit=-1.0)),
    ("MAP-UNIT", PLAIN, put("map", unit=NAN)),
    ("MAP-WINDOW", PLAIN, put("map", x1=-1)),
    ("LEVEL-ERROR", PLAIN, put("level", max_error=1.5)),
    ("LEVEL-ERROR", PLAIN, put("level", max_error=NAN)),
    ("LEVEL-VERTICES", PLAIN, put("level", vertices=4)),
    ("LEVEL-BYTES", PLAIN, put("level", payload_bytes=0)),
    ("BLOCK-RANGE", PLAIN, put("block", offset=64)),
    ("BLOCK-RANGE", PLAIN, put("block", stored_size=2**32 - 8)),
    ("BLOCK-CRC", PLAIN, put("block", crc=0)),
    ("BLOCK-PADDING", PLAIN, put("block", padding=8)),
    ("BLOCK-RESERVED", PLAIN, put("block", reserved=b"\0\0\0\0\0\1")),
    ("BLOCK-COVER", PLAIN, change("after blocks", grow)),
    ("BLOCK-SIZE", PLAIN, change("block data", lambda b: b + bytes(8))),
    ("GROUP-NAME", grouped(("g", 1, [0]), ("g", 1, [1])), no_edit),
    ("GROUP-ROLE", grouped(("g", 3, [0])), no_edit),
    ("GROUP-MAPS", grouped(("g", 1, [])), no_edit),
    ("GROUP-MAPS", grouped(("g", 1, [0, 0])), no_edit),
    ("GROUP-MAPS", grouped(("g", 1, [2])), no_edit),
    ("ATTRIBUTE-NAME", attributed(("a", 0, b""), ("a", 0, b"")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 0, b"\xff")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 1, b"")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 2, b"1234567")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 3, b"\0\0x")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 3, b"\2\0x")), no_edit),
    ("ATTRIBUTE-VALUE", attributed(("a", 3, b"")), no_edit),
    ("TILE-KIND", PLAIN, put("entry", kind=3)),
    ("TILE-EMPTY", EMPTY, put("entry", z_min=-0.0)),
    ("TILE-EMPTY", EMPTY, put("entry", end_min=0.5)),
    ("TILE-EMPTY", EMPTY, put("entry", codec=1)),
    ("TILE-CONSTANT", CONSTANT, put("entry", vertices=34)),
    ("TILE-CONSTANT", CONSTANT, put("entry", z_max=3.0)),
    ("TILE-CONSTANT", CONSTANT, put("entry", z_max=-0.0, z_min=-0.0)),
    ("TILE-CONSTANT", CONSTANT, put("entry", z_max=INF, z_min=INF)),
    ("TILE-CONSTANT", CONSTANT, put("entry", z_max=NAN, z_min=NAN)),
    ("TILE-CONSTANT", CONSTANT, put("entry", end_min=1.0, end_max=1.0)),
    ("TILE-CONSTANT", CONSTANT, put("entry", lattice=1)),
    ("TILE-RANGE", PLAIN, put("entry", offset=68)),
    ("TILE-RANGE", PLAIN, put("entry", offset=lambda e: e["offset"] + 8)),
    ("TILE-RANGE", PLAIN, put("entry", offset=56)),
    ("TILE-SIZE", PLAIN, put("entry", decoded_size=2**31 + 8)),
    ("TILE-SIZE", PLAIN, change("decoded", lambda b: b + bytes(8))),
    ("TILE-SIZE", PLAIN, change("decoded", lambda b: b[:-8])),
    ("TILE-VERTICES", PLAIN, put("entry", vertices=0)),
    ("TILE-VERTICES", DELTA, put("entry", vertices=4)),
    ("TILE-CRC", PLAIN, put("entry", crc=0)),
    ("TILE-DEPTHS", PLAIN, put("entry", z_min=1.0)),
    ("TILE-DEPTHS", PLAIN, put("entry", z_max=NAN)),
    ("TILE-ENDS", PLAIN, put("entry", end_min=0.5)),
    ("TILE-ENDS", PLAIN, put("entry", end_max=0.25)),
    ("TILE-PADDING", PLAIN, put("entry", padding=8)),
    ("TILE-PADDING", DELTA, change("stored", lambda b: b[:-1] + b"\1")),
    ("TILE-PADDING", LATTICE, change("decoded", lambda b: b[:-1] + b"\1")),
    ("TILE-LATTICE", one_pixel([1.0], [11], lattice=10), no_edit),
    ("TILE-LATTICE", one_pixel([1.0], [11], lattice=10, transform=1), no_edit),
    ("TILE-FLAGS", PLAIN, put("entry", flags=2)),
    ("TILE-FLAGS", COLOUR, change("decoded", lambda b: b[:144] + bytes(144) + b[288:304])),
    ("TILE-COVER", TWO_TILES, overlap()),
    ("TILE-COVER", PLAIN, change("after tiles", grow)),
    ("TILE-CODEC", PLAIN, put("entry", decoded_size=lambda e: e["decoded_size"] - 8)),
    ("TILE-TABLE", PLAIN, change("decoded", at(0, b"\1"))),
    ("TILE-TABLE", PLAIN, change("decoded", at(4 * 34, b"\4"))),
    ("TILE-TABLE", PLAIN, put("entry", vertices=2)),
    ("TILE-SIZE", PLAIN, put("entry", vertices=4)),
    ("TILE-COLOUR", COLOUR, change("decoded", at(144, b"\1"))),
    ("TILE-COLOUR", COLOUR, change("decoded", at(144 + 4 * 14, b"\1"))),
    ("TILE-STREAM", DELTA, change("decoded", lambda b: b + bytes(8))),
    ("TILE-STREAM", DELTA, change("decoded", lambda b: b[:-8])),
    ("TILE-STREAM", DELTA, change("decoded", at(140, b"\6"))),  # an unused step bit
    ("TILE-STREAM", DELTA, change("decoded", at(145, bytes(4)))),  # a gap of 0
    ("DEPTH-FINITE", one_pixel([1.0, INF], [0.5, 0.25]), no_edit),
    ("DEPTH-FINITE", one_pixel([NAN], [0.5]), no_edit),
    ("DEPTH-ZERO", one_pixel([-0.0], [0.5]), no_edit),
    ("DEPTH-ZERO", one_pixel([1.0], [-0.0]), no_edit),
    ("DEPTH-ZERO", one_pixel([1.0], [-0.0], transform=1), no_edit),
    ("DEPTH-ORDER", one_pixel([1.0, 0.5], [0.5, 0.25]), no_edit),
    ("DEPTH-ORDER", one_pixel([1.0, 0.5], [0.5, 0.25], transform=1), no_edit),
    ("DEPTH-FIRST", one_pixel([1.0, 1.0], [0.5, 0.25]), no_edit),
    ("DEPTH-PAIR", one_pixel([1.0, 2.0, 2.0, 2.0], [0.9, 0.5, 0.25, 0.1]), no_edit),
    ("VISIBILITY-RANGE", one_pixel([1.0], [1.5]), no_edit),
    ("VISIBILITY-RANGE", one_pixel([1.0], [-0.5], transform=1), no_edit),
    ("VISIBILITY-RANGE", one_pixel([1.0], [NAN]), no_edit),
    ("VISIBILITY-RISE", one_pixel([1.0, 2.0], [0.5, 0.75]), no_edit),
    ("VISIBILITY-RISE", one_pixel([1.0, 2.0], [5, 6], lattice=65535, transform=1), no_edit),
    ("VISIBILITY-RISE", one_pixel([1.0, 2.0], [1.0, 0.5, 0.5, 0.5, 0.5, 0.75], 3), no_edit),
    ("VERTEX-STEP", one_pixel([1.0, 2.0, 2.0, 3.0], [0.5, 0.25, 0.25, 0.1]), no_edit),
    ("VERTEX-REDUNDANT", one_pixel([1.0, 2.0], [0.5, 0.5]), no_edit),
    ("VERTEX-REDUNDANT", one_pixel([1.0, 2.0, 3.0], [1.0, 1.0, 0.5]), no_edit),
    ("VERTEX-REDUNDANT", one_pixel([1.0], [1.0]), no_edit),
    ("COLOUR-EQUAL", one_pixel([1.0], [0.5, 0.5, 0.5], 3), no_edit),
]
for codec in CODECS[1:]:
    PACKED = a_file(a_map(codec=codec, block_codec=codec, transform=1))
    BROKEN += [
        ("TILE-CODEC", PACKED, change("encoded", lambda b: b + bytes(8))),
        ("TILE-CODEC", PACKED, change("encoded", lambda b: b[:-1])),
        ("TILE-RANGE", PACKED, change("encoded", lambda b: b"")),
        ("TILE-CODEC", PACKED, put("entry", decoded_size=lambda e: e["decoded_size"] + 1)),
        ("TILE-CODEC", PACKED, put("entry", decoded_size=lambda e: e["decoded_size"] - 1)),
        ("BLOCK-SIZE", PACKED, change("block data", lambda b: b + bytes(8))),
        ("BLOCK-SIZE", PACKED, change("block data", lambda b: b[:-1])),
        ("BLOCK-PADDING", PACKED, change("block stored", lambda b: b[:-1] + b"\1")),
    ]
UNSUPPORTED = [
    (PLAIN, change("header", at(8, b"\2"))),
    (PLAIN, put("footer", required=1)),
    (PLAIN, put("entry", codec=128)),
    (PLAIN, put("entry", transform=2)),
    (PLAIN, put("block", codec=3)),
]


def build(file, edit=no_edit):
    return Writer(edit).write(file)


def verdict(data):
    """The rule that a file breaks, or "unsupported", "too large" or "good"."""
    try:
        reader.read_bytes(data)
        return "good"
    except reader.Broken as broken:
        return broken.rule
    except reader.Unsupported:
        return "unsupported"
    except reader.TooLarge:
        return "too large"


class ReaderTest(unittest.TestCase):
    def check(self, file):
        """Asserts that the reader returns exactly the values that were written."""
        data = build(file)
        read = reader.read_bytes(data)
        self.assertEqual(len(read.maps), len(file["maps"]))
        for m, r in zip(file["maps"], read.maps):
            for field in (
                "name",
                "width",
                "height",
                "channels",
                "tile_log2",
                "depth_kind",
                "interpretation",
            ):
                self.assertEqual(getattr(r, field), m[field])
            self.assertEqual(
                (r.depth_unit, r.data_origin, r.display_window),
                (m["unit"], m["origin"], m["window"]),
            )
            self.assertEqual((r.worldToCamera, r.worldToNDC), m["camera"])
            self.assertEqual(
                [level.max_error for level in r.levels],
                [level["max_error"] for level in m["levels"]],
            )
            for wrote, level in zip(m["levels"], r.levels):
                expected = {
                    at: (c, z, [visible(v, m["lattice"]) for v in s])
                    for at, (c, z, s) in wrote["pixels"].items()
                }
                self.assertEqual({(x, y): f for x, y, f in level.functions()}, expected)
                for y in range(level.height):
                    for x in range(level.width):
                        self.assertEqual(level.function(x, y), expected.get((x, y), (1, [], [])))
        self.assertEqual([(g.name, g.role, list(g.maps)) for g in read.groups], file["groups"])
        self.assertEqual(reader.content_hash(read), model_hash(file))
        return read

    def test_random_files(self):
        for seed in range(300):
            rng = random.Random(seed)
            with self.subTest(seed=seed):
                self.check(
                    a_file(
                        random_map(rng, "one"),
                        random_map(rng, "zwei ü"),
                        groups=[("g", 1, [1, 0]), ("h", 2, [0])],
                    )
                )

    def test_every_encoding(self):
        for codec in CODECS:
            for transform in (0, 1):
                for lattice in (0, 1, 1000, 65535):
                    for channels in (1, 3):
                        rng = random.Random(codec * 100 + transform * 10 + channels)
                        self.check(
                            a_file(
                                random_map(
                                    rng,
                                    "m",
                                    width=29,
                                    height=27,
                                    codec=codec,
                                    block_codec=codec,
                                    transform=transform,
                                    lattice=lattice,
                                    channels=channels,
                                )
                            )
                        )

    def test_many_blocks(self):
        pixels = {(x, 5): (1, [float(x)], [0.5]) for x in range(0, 8 * 1100, 700)}
        for codec in CODECS:
            self.check(
                a_file(
                    a_map(
                        width=8 * 1100,
                        height=9,
                        codec=codec,
                        block_codec=codec,
                        levels=[dict(max_error=0.5, pixels=pixels)],
                    )
                )
            )

    def test_attributes(self):
        attributes = [
            ("t", 0, "tëxt\0\n".encode()),
            ("i", 1, struct.pack("<2q", -1, 2**62)),
            ("f", 2, struct.pack("<d", 0.1)),
            ("o", 3, b"\x08\0exr:rati\1\2"),
            ("x", 200, b"abc"),
        ]
        file = reader.read_bytes(
            build(a_file(a_map(attributes=attributes), attributes=attributes[::-1], optional=5))
        )
        expected = [
            ("tëxt\0\n", None),
            ((-1, 2**62), None),
            ((0.1,), None),
            (b"\1\2", "exr:rati"),
            (b"abc", None),
        ]
        self.assertEqual([(a.value, a.type) for a in file.maps[0].attributes], expected)
        self.assertEqual([(a.value, a.type) for a in file.attributes], expected[::-1])
        self.assertEqual(file.optional_features, 5)

    def test_rules(self):
        for i, (rule, file, edit) in enumerate(BROKEN):
            with self.subTest(rule=rule, case=i):
                self.assertEqual(verdict(build(file, edit)), rule)
        for i, (file, edit) in enumerate(UNSUPPORTED):
            with self.subTest(unsupported=i):
                self.assertEqual(verdict(build(file, edit)), "unsupported")

    def test_counts_above_the_limit_break_no_other_rule(self):
        """The vectors of these rules are too short for their counts: here are whole files."""
        many = [(f"n{i}", 0, b"") for i in range(65537)]
        for rule, file in [
            ("ATTRIBUTE-COUNT", a_file(a_map(), attributes=many)),
            ("ATTRIBUTE-COUNT", attributed(*many)),
            ("GROUP-COUNT", a_file(a_map(), groups=[(n, 1, [0]) for n, _, _ in many])),
        ]:
            data = build(file)
            self.assertEqual(verdict(data), rule)
            reader.read_bytes(data, {rule})

    def test_every_rule_is_tested(self):
        here = os.path.dirname(os.path.abspath(__file__))
        text = "".join(
            pathlib.Path(here, page).read_text("utf-8") for page in ("format.md", "semantics.md")
        )
        ids = set(re.findall(r"`([A-Z]+-[A-Z]+)`", text))
        elsewhere = {"FILE-SHORT", "HEADER-CRC", "TRAILER-CRC"}  # test_truncated and test_bit_flips
        self.assertEqual(ids - {rule for rule, _, _ in BROKEN} - elsewhere - {"DSM-END"}, set())
        self.assertEqual({rule for rule, _, _ in BROKEN} - ids, set())

    def small_files(self):
        yield build(
            a_file(
                a_map(
                    lattice=10,
                    transform=1,
                    levels=[dict(max_error=0.1, pixels={(3, 2): (1, [1.0, 2.0], [9, 3])})],
                )
            )
        )
        yield build(dict(COLOUR, attributes=[("a", 1, bytes(8))]))
        for codec in CODECS[1:]:
            yield build(a_file(a_map(codec=codec, block_codec=codec, transform=1)))

    def test_bit_flips(self):
        rules = set()
        for data in self.small_files():
            self.assertEqual(verdict(data), "good")
            for bit in range(8 * len(data)):
                flipped = bytearray(data)
                flipped[bit // 8] ^= 1 << bit % 8
                rules.add(verdict(bytes(flipped)))
                self.assertNotIn("good", rules, f"bit {bit}")
        self.assertLessEqual({"HEADER-CRC", "TRAILER-CRC"}, rules)

    def test_truncated(self):
        for data in self.small_files():
            for length in range(len(data)):
                self.assertEqual(
                    verdict(data[:length]), "FILE-SHORT" if length < 128 else "TRAILER-COMMIT"
                )
            self.assertEqual(verdict(data + bytes(8)), "TRAILER-COMMIT")
            self.assertEqual(verdict(data + data[-64:]), "FILE-LENGTH")

    def test_damage_with_valid_checksums(self):
        """Changes bytes before checksums are computed; only an unknown exception is a failure."""
        rng = random.Random(1)
        stages = [
            "header",
            "entries",
            "decoded",
            "encoded",
            "stored",
            "block data",
            "block stored",
            "footer bytes",
            "trailer bytes",
        ]
        for trial in range(6000):
            stage = rng.choice(stages)

            def spoil(data):
                data = bytearray(data)
                for _ in range(rng.randrange(1, 3)):
                    if data:
                        data[rng.randrange(len(data))] = rng.choice(
                            [0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)]
                        )
                return bytes(data)

            file = a_file(
                random_map(rng, "m", width=rng.randrange(1, 6), height=rng.randrange(1, 6)),
                groups=[("g", 1, [0])],
                attributes=[("a", 3, b"\1\0x")],
            )
            with self.subTest(trial=trial):
                verdict(build(file, change(stage, spoil)))

    def test_forged_sizes(self):
        huge = put("map", width=2**20, height=2**20)
        self.assertEqual(verdict(build(PLAIN, huge)), "FOOTER-SHORT")
        self.assertEqual(verdict(build(PLAIN, put("entry", decoded_size=2**31))), "too large")
        for stage, field in (
            ("footer", "maps"),
            ("footer", "groups"),
            ("map", "attribute_count"),
            ("footer", "attributes"),
        ):
            self.assertRegex(
                verdict(build(PLAIN, put(stage, **{field: 65536}))), "FOOTER-SHORT|[A-Z]*-NAME"
            )
        if reader.zstandard:  # a frame that decodes to more bytes than it states
            bomb = reader.zstandard.ZstdCompressor().compress(bytes(1 << 24))
            forged = bomb[:4] + bytes([0xA0]) + struct.pack("<I", 140 + 24) + bomb[9:]
            self.assertEqual(
                verdict(
                    build(
                        DELTA,
                        lambda s, v: (
                            forged if s == "encoded" else dict(v, codec=2) if s == "entry" else v
                        ),
                    )
                ),
                "TILE-CODEC",
            )

    def lz4(self, block, size):
        """The bytes of an LZ4 block, or None if the reader refuses it."""
        try:
            data = reader.decode_lz4(block, size, "TILE-CODEC", reader.Place(frozenset()))
            return data if len(data) == size else None
        except reader.Broken:
            return None

    @unittest.skipUnless(lz4_block, "the package lz4 is not installed")
    def test_lz4_agrees_with_liblz4(self):
        rng = random.Random(3)
        accepted = 0
        for _ in range(5000):
            data = bytes(rng.choices(range(rng.randrange(1, 6)), k=rng.randrange(1, 80)))
            block = bytearray(lz4_block.compress(data, store_size=False))
            self.assertEqual(self.lz4(block, len(data)), data)
            for _ in range(rng.randrange(1, 3)):
                change, at = rng.randrange(3), rng.randrange(len(block))
                if change == 0:
                    block[at] = rng.choice([0, 1, 4, 15, 16, 80, 240, 255, rng.randrange(256)])
                elif change == 1 and len(block) > 1:
                    del block[at]
                else:
                    block.insert(at, rng.randrange(4))
            for size in {len(data), len(data) + rng.randrange(-3, 4)} - {0, -1, -2}:
                try:
                    theirs = lz4_block.decompress(bytes(block), uncompressed_size=size)
                    theirs = theirs if len(theirs) == size else None
                except (lz4_block.LZ4BlockError, ValueError):
                    theirs = None
                ours = self.lz4(block, size)
                accepted += ours is not None
                if ours != theirs:
                    # liblz4 accepts offsets of 0, which the format does not allow.
                    self.assertIsNone(ours)
                    self.assertIn(b"\0\0", bytes(block))
        self.assertGreater(accepted, 300)

    def test_lookups(self):
        step = (1, [1.0, 3.0, 3.0], [1.0, 0.5, 0.25])
        for z, at, behind in [
            (0.5, 1, 1),
            (1, 1, 1),
            (2, 0.75, 0.75),
            (3, 0.5, 0.25),
            (4, 0.25, 0.25),
        ]:
            self.assertEqual(reader.visibility(step, z), (at,))
            self.assertEqual(reader.visibility(step, z, behind=True), (behind,))
        wall = (3, [2.0], [0.5, 0.25, 0.0])
        self.assertEqual(reader.visibility(wall, 2.0), (1, 1, 1))
        self.assertEqual(reader.visibility(wall, 2.0, behind=True), (0.5, 0.25, 0))
        self.assertEqual(reader.visibility((1, [], []), 2.0), (1,))

    def test_lattice_is_nearest(self):
        for lattice in (1, 3, 10, 255, 1000, 4095, 65534, 65535):
            ks = range(0, lattice + 1, 1 + lattice // 5000)
            self.assertEqual(
                list(reader.lattice_values(ks, lattice)),
                [nearest_f32(Fraction(k, lattice)) for k in ks],
            )
            self.assertEqual(
                len(set(reader.lattice_values(range(lattice + 1), lattice))), lattice + 1
            )

    def test_shortest_decimals(self):
        expected = {
            0.0: "0",
            0.5: "0.5",
            2.0: "2",
            -1e10: "-10000000000",
            2.0**-149: "1e-45",
            2.0**127: "1.7014118e+38",
            2.0**-44: "5.684342e-14",
            16777216.0: "16777216",
            9007199254740992.0: "9007199000000000",
            1e-5: "1e-05",
        }
        for value, text in expected.items():
            self.assertEqual(
                reader.shortest(struct.unpack("<f", struct.pack("<f", value))[0]), text
            )
        rng = random.Random(2)
        for bits in [e << 23 for e in range(255)] + [
            rng.randrange(0x7F800000) for _ in range(3000)
        ]:
            below, x, above = (
                Fraction(struct.unpack("<f", struct.pack("<I", b))[0])
                if b < 0x7F800000
                else Fraction(2) ** 128
                for b in (max(bits - 1, 0), bits, bits + 1)
            )
            text = reader.shortest(float(x))
            self.assertTrue((below + x) / 2 <= Fraction(text) <= (x + above) / 2, (bits, text))
            digits = len(text.split("e")[0].replace(".", "").strip("0"))
            if x and digits > 1:  # no decimal with one digit less is nearest to x
                unit = Fraction(10) ** (math.floor(math.log10(x)) - digits + 2)
                for n in range(x // unit - 1, x // unit + 3):
                    self.assertFalse((below + x) / 2 < n * unit < (x + above) / 2, (bits, text))

    def run_program(self, *arguments):
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            code = reader.main(list(arguments))
        return code, out.getvalue()

    def test_program(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "a.dsm")
            pathlib.Path(path).write_bytes(build(dict(COLOUR, attributes=[("o", 3, b"\1\0x\xff")])))
            self.assertEqual(self.run_program("--verify", path), (0, "good\n"))
            self.assertEqual(self.run_program("--hash", path)[0], 0)
            self.assertEqual(
                self.run_program("--dump", path),
                (
                    0,
                    """\
dsm 1 maps 1 groups 0 attributes 1 optional_features 0x0
map 0 "sun" 5x7 channels 3 tile 8 levels 1 \
depth planar unit 0 interpretation discrete origin 0,0 window 0,0,4,6 attributes 0
level 0 5x7 max_error 0
pixel 3,2 rgb 1:1,0.5,0.5 2:0,0.5,0.5
attribute "o" opaque "x" ff
""",
                ),
            )
            self.assertEqual(self.run_program(path)[0], 0)
            pathlib.Path(path).write_bytes(build(PLAIN, put("entry", crc=0)))
            self.assertEqual(
                self.run_program("--verify", path),
                (
                    1,
                    "file breaks rule TILE-CRC: the stored bytes are damaged "
                    "(map 0, level 0, tile 0)\n",
                ),
            )
            for arguments in (
                [],
                ["--verify"],
                ["--what", path],
                [path, path],
                [path + ".none"],
                [folder],
            ):
                self.assertEqual(self.run_program(*arguments)[0], 2)


if __name__ == "__main__":
    unittest.main()

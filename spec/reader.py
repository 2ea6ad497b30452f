#!/usr/bin/env python3
"""An independent reader of `.dsm` files, version 1, written from format.md and semantics.md alone.

As a module:   read(path) -> File; raises Broken, Unsupported or TooLarge (subclasses of Refused).
As a program:  reader.py [--verify | --dump | --hash] FILE

It always reads the whole file and checks every rule of the two pages, including the four rules of
the full check. It needs the standard library only; it decodes zstd if the package `zstandard` is
installed. Section numbers are those of format.md; "laws" are section 3 of semantics.md.

For tests, read_bytes takes `skip`, a set of rules that are not checked. The reader then goes on as
well as it can, and raises Stuck if it cannot. check.py uses this to show that each invalid vector
breaks one rule only.
"""

import bisect
import collections
import decimal
import functools
import hashlib
import io
import json
import math
import os
import struct
import sys
import zlib
from array import array
from fractions import Fraction

try:
    import zstandard
except ImportError:
    zstandard = None

# Limits of this reader, not of the format (section 11): decoded bytes, tiles and hashed pixels of
# one file.
MAX_DECODED = 1 << 30
MAX_TILES = 1 << 20
MAX_HASHED_PIXELS = 1 << 28

MAGIC = bytes.fromhex("89 44 53 4D 0D 0A 1A 0A")
COMMIT_MARK = b"DSM-END\n"
ENTRY_SIZE, ENTRIES_PER_BLOCK = 48, 1024
EMPTY, CONSTANT, DATA = 0, 1, 2
DEPTH_KINDS = ("unspecified", "planar", "ray")
INTERPRETATIONS = ("unspecified", "discrete", "continuous")
ROLES = {1: "faces", 2: "clusters"}
MASK = 0xFFFFFFFF
SIGN = 0x80000000


class Refused(Exception):
    """The file is refused; str() gives the reason in one line."""


class Broken(Refused):
    def __init__(self, rule, what, where):
        super().__init__(f"file breaks rule {rule}: {what}{where}")
        self.rule = rule


class Unsupported(Refused):
    def __init__(self, what, where):
        super().__init__(f"unsupported: {what}{where}")


class TooLarge(Refused):
    def __init__(self, what, where=""):
        super().__init__(f"too large for this reader: {what}{where}")


class Stuck(Refused):
    """A rule was skipped, and nothing remains that could be read."""


class Place:
    """A place in the file, for errors, and the rules that are not checked there."""

    def __init__(self, skip, parts=()):
        self.skip, self.parts = skip, parts

    def at(self, part):
        return Place(self.skip, (*self.parts, part))

    def __str__(self):
        return f" ({', '.join(self.parts)})" if self.parts else ""


def need(condition, rule, what, where):
    if not condition and rule not in where.skip:
        raise Broken(rule, what, where)


# ---- Section 2: conventions ----------------------------------------------------------------------


def numbers(typecode, data):
    """Decodes little-endian bytes: "I" is u32, "H" is u16, "f" is f32 (exact as a float)."""
    result = array(typecode)
    result.frombytes(data)
    if sys.byteorder == "big":
        result.byteswap()
    return result


def from_planes(data, width):
    """The values of `width` bytes whose byte planes are `data`."""
    count = len(data) // width
    out = bytearray(len(data))
    for i in range(width):
        out[i::width] = data[i * count : (i + 1) * count]
    return bytes(out)


def bits_of(data):
    """The bits of `data`, lowest bit first, as a string of 0 and 1."""
    return format(int.from_bytes(data, "little"), f"0{8 * len(data)}b")[::-1] if data else ""


def same_f32(a, b):
    """Whether two f32 are equal bit for bit, so that -0 differs from +0."""
    return struct.pack("<f", a) == struct.pack("<f", b)


def lattice_values(ks, lattice):
    """The f32 nearest to k / L for each k.

    Python divides to the nearest f64, and array("f") rounds that to the nearest f32. Rounding twice
    gives the same f32 as rounding once, unless the f64 is a midpoint M / 2^j of two neighbouring
    f32 (M odd, 25 bits) and k / L is not. That does not happen: k / L differs from a midpoint by
    |k 2^j - M L| / (L 2^j) >= 1 / (L 2^j), more than 2^-41 of its value, and rounding to f64
    changes it by at most 2^-53 of its value. k / L is never a midpoint itself: M would divide
    k < 2^16. The smallest quotient, 1/65535, is a normal f32. Different k give different f32.
    """
    quotients = {k: k / lattice for k in set(ks)}
    return array("f", (quotients[k] for k in ks))


# ---- Decoded files -------------------------------------------------------------------------------


class Record:
    """An object with the given fields."""

    def __init__(self, **fields):
        self.__dict__.update(fields)


class File(Record):
    """Fields: maps, groups (name, role, maps), attributes, required_ and optional_features."""


class Map(Record):
    """Fields: those of section 5.1, worldToCamera and worldToNDC (or None), levels, attributes."""


class Attribute(Record):
    """Fields: name, kind, type (kind 3 only), value (str, tuple of int or float, or bytes)."""


class Level(Record):
    """Fields: index, width, height, tile (pixels a side), tiles_x, tiles_y, blocks, entries, tiles,
    max_error, vertices, payload_bytes."""

    def tile_size(self, index):
        ty, tx = divmod(index, self.tiles_x)
        return min(self.tile, self.width - tx * self.tile), min(
            self.tile, self.height - ty * self.tile
        )

    def function(self, x, y):
        """(channels, depths, visibilities) of a pixel; the channels of a vertex are adjacent."""
        index = (y // self.tile) * self.tiles_x + x // self.tile
        tile = self.tiles[index]
        if tile is None:
            return 1, [], []
        return tile.function((y % self.tile) * self.tile_size(index)[0] + x % self.tile)

    def functions(self):
        """(x, y, function) of every pixel that has vertices, row by row."""
        for ty in range(self.tiles_y):
            row = [
                (tx, ty * self.tiles_x + tx)
                for tx in range(self.tiles_x)
                if self.tiles[ty * self.tiles_x + tx]
            ]
            if not row:
                continue
            for y in range(self.tile_size(ty * self.tiles_x)[1]):
                for tx, index in row:
                    width = self.tile_size(index)[0]
                    for x in range(width):
                        function = self.tiles[index].function(y * width + x)
                        if function[1]:
                            yield tx * self.tile + x, ty * self.tile + y, function


Entry = collections.namedtuple(
    "Entry",
    "offset stored_size decoded_size vertices crc z_min z_max end_min end_max "
    "kind codec transform padding lattice flags",
)


class ConstantTile:
    def __init__(self, depth, visibility):
        self.depth, self.visibility = depth, visibility

    def function(self, _pixel):
        return 1, [self.depth], [self.visibility]


class DataTile:
    """The tables of section 7, the depths, and one array of visibilities per channel."""

    def __init__(self, table, colour, depths, planes):
        self.table, self.colour, self.depths, self.planes = table, colour, depths, planes

    def columns(self, pixel):
        """The depths of a pixel, and one list of visibilities per channel."""
        a, b = self.table[pixel], self.table[pixel + 1]
        columns = [self.planes[0][a:b].tolist()]
        if self.colour and self.colour[pixel] != self.colour[pixel + 1]:
            c, d = self.colour[pixel], self.colour[pixel + 1]
            columns += [plane[c:d].tolist() for plane in self.planes[1:]]
        return self.depths[a:b].tolist(), columns

    def function(self, pixel):
        depths, columns = self.columns(pixel)
        return len(columns), depths, [v for row in zip(*columns) for v in row]


def visibility(function, z, behind=False):
    """V of each channel at depth z, or just behind it (semantics.md, section 1)."""
    channels, depths, values = function
    i = bisect.bisect_left(depths, z)  # the first vertex that is not in front of z
    j = bisect.bisect_right(depths, z) - 1  # the last vertex that is not behind z

    def vertex(k):
        return tuple(values[k * channels : (k + 1) * channels]) if k >= 0 else (1.0,) * channels

    if behind and j >= i:
        return vertex(j)
    if i == 0 or i == len(depths) or depths[i] == z:
        return vertex(min(i, len(depths) - 1) if i else -1)
    t = (z - depths[i - 1]) / (depths[i] - depths[i - 1])
    return tuple(a + (b - a) * t for a, b in zip(vertex(i - 1), vertex(i)))


# ---- Sections 3 and 4: header and trailer --------------------------------------------------------


def read(path):
    """Reads and checks a file."""
    with open(path, "rb") as stream:
        return read_stream(stream)


def read_bytes(data, skip=()):
    return read_stream(io.BytesIO(data), skip)


def read_stream(stream, skip=()):
    try:
        return Reader(stream, skip).file()
    except MemoryError:
        raise TooLarge("out of memory") from None
    except (IndexError, OverflowError, StopIteration, ValueError, struct.error) as error:
        if skip:
            raise Stuck(f"cannot go on without {', '.join(sorted(skip))}: {error}") from error
        raise


class Reader:
    def __init__(self, stream, skip=()):
        self.stream = stream
        self.where = Place(frozenset(skip))
        self.length = stream.seek(0, os.SEEK_END)
        self.decoded = 0  # bytes decoded so far, against MAX_DECODED
        self.tile_count = 0

    def at(self, offset, size):
        """Bytes of the file; the caller must check that they lie within it."""
        self.stream.seek(offset)
        data = self.stream.read(size)
        if len(data) != size:
            if self.where.skip:
                raise Stuck("no such bytes")
            raise Broken("FILE-LENGTH", "the file became shorter while it was read", self.where)
        return data

    def spend(self, size, where):
        self.decoded += size
        if self.decoded > MAX_DECODED:
            raise TooLarge(f"more than {MAX_DECODED} bytes to decode", where)

    def file(self):
        self.header()
        self.trailer()
        file = Footer(self).read()
        self.check_block_cover(file)
        for m, map_ in enumerate(file.maps):
            for level in map_.levels:
                self.read_entries(map_, level, self.where.at(f"map {m}").at(f"level {level.index}"))
        self.check_tile_cover(file)
        for m, map_ in enumerate(file.maps):
            for level in map_.levels:
                where = self.where.at(f"map {m}").at(f"level {level.index}")
                for t, entry in enumerate(level.entries):
                    tile = self.read_tile(entry, level.tile_size(t), where.at(f"tile {t}"))
                    level.tiles.append(tile)
        return file

    def header(self):
        data = self.at(0, min(64, self.length))
        need(MAGIC.startswith(data[:8]), "HEADER-MAGIC", "not a .dsm file", self.where)
        need(self.length >= 128, "FILE-SHORT", f"{self.length} bytes", self.where)
        version, header_size = struct.unpack_from("<HH", data, 8)
        if version != 1:
            raise Unsupported(f"version {version}", self.where)
        need(
            zlib.crc32(data[:60]) == struct.unpack_from("<I", data, 60)[0],
            "HEADER-CRC",
            "the header is damaged",
            self.where,
        )
        need(header_size == 64, "HEADER-SIZE", f"header_size is {header_size}", self.where)
        need(not any(data[12:60]), "HEADER-RESERVED", "reserved bytes are not zero", self.where)

    def trailer(self):
        begin = self.length - 64
        data = self.at(begin, 64)
        need(
            data[52:60] == COMMIT_MARK,
            "TRAILER-COMMIT",
            "no commit mark: the file was truncated or never finished",
            self.where,
        )
        need(
            zlib.crc32(data[:60]) == struct.unpack_from("<I", data, 60)[0],
            "TRAILER-CRC",
            "the trailer is damaged",
            self.where,
        )
        length, self.directory, self.footer, self.footer_size, self.footer_crc, version = (
            struct.unpack_from("<QQQQIH", data)
        )
        need(version == 1, "TRAILER-VERSION", f"version {version}", self.where)
        need(not any(data[38:52]), "TRAILER-RESERVED", "reserved bytes are not zero", self.where)
        need(
            length == self.length,
            "FILE-LENGTH",
            f"{self.length} bytes instead of {length}",
            self.where,
        )
        need(
            self.footer % 8 == 0
            and self.footer_size % 8 == 0
            and self.footer + self.footer_size == begin
            and self.footer_size <= 1 << 31,
            "FOOTER-RANGE",
            f"offset {self.footer}, size {self.footer_size} in a file of {self.length}",
            self.where,
        )
        need(
            self.directory % 8 == 0 and 64 <= self.directory <= self.footer,
            "DIRECTORY-RANGE",
            f"offset {self.directory}",
            self.where,
        )

    # ---- Section 6: directory --------------------------------------------------------------------

    def check_block_cover(self, file):
        blocks = [
            (b.offset, b.stored_size) for m in file.maps for level in m.levels for b in level.blocks
        ]
        check_cover(blocks, self.directory, self.footer, "BLOCK-COVER", self.where)

    def check_tile_cover(self, file):
        tiles = [
            (e.offset, e.stored_size)
            for m in file.maps
            for level in m.levels
            for e in level.entries
            if e
        ]
        tiles = [tile for tile in tiles if tile[1]]
        check_cover(tiles, 64, self.directory, "TILE-COVER", self.where)

    def read_entries(self, map_, level, where):
        """All entries of a level, None for an empty tile; checks all rules that need no payload."""
        count = level.tiles_x * level.tiles_y
        self.tile_count += count
        if self.tile_count > MAX_TILES:
            raise TooLarge(f"more than {MAX_TILES} tiles", where)
        for b, block in enumerate(level.blocks):
            size = ENTRY_SIZE * min(ENTRIES_PER_BLOCK, count - b * ENTRIES_PER_BLOCK)
            self.spend(size, where)
            data = self.read_block(block, size, where.at(f"block {b}"))
            for i in range(0, size, ENTRY_SIZE):
                t = len(level.entries)
                record, place = data[i : i + ENTRY_SIZE], where.at(f"tile {t}")
                level.entries.append(self.read_entry(record, map_, level.tile_size(t), place))
        entries = [e for e in level.entries if e]
        need(
            level.vertices == sum(e.vertices for e in entries),
            "LEVEL-VERTICES",
            f"{level.vertices} is not the sum",
            where,
        )
        need(
            level.payload_bytes == sum(e.stored_size for e in entries),
            "LEVEL-BYTES",
            f"{level.payload_bytes} is not the sum",
            where,
        )

    def read_block(self, block, size, where):
        stored = self.at(block.offset, block.stored_size)
        need(zlib.crc32(stored) == block.crc, "BLOCK-CRC", "the directory block is damaged", where)
        body = without_padding(stored, block.padding, "BLOCK-PADDING", where)
        data = decode(body, block.codec, size, "BLOCK-SIZE", where)
        return data if block.codec == 0 else from_planes(data, ENTRY_SIZE)

    def read_entry(self, data, map_, tile_size, where):
        pixels = tile_size[0] * tile_size[1]
        e = Entry(*struct.unpack("<QIIIIffffBBBBHH", data))
        need(e.kind <= DATA, "TILE-KIND", f"kind {e.kind}", where)
        if e.kind == EMPTY:
            need(
                data == struct.pack("<32xff8x", 1.0, 1.0),
                "TILE-EMPTY",
                "a field of an empty tile is not what it must be",
                where,
            )
            return None
        if e.kind == CONSTANT:
            check_constant(e, data, pixels, where)
            return e
        need(e.flags <= 1, "TILE-FLAGS", f"flags {e.flags}", where)
        need(
            not e.flags & 1 or map_.channels == 3,
            "MAP-CHANNELS",
            "a coloured tile in a monochrome map",
            where,
        )
        need(e.padding <= 7, "TILE-PADDING", f"padding {e.padding}", where)
        need(
            e.offset % 8 == 0
            and e.stored_size % 8 == 0
            and e.stored_size
            and 64 <= e.offset
            and e.offset + e.stored_size <= self.directory,
            "TILE-RANGE",
            f"offset {e.offset}, size {e.stored_size}",
            where,
        )
        need(0 < e.decoded_size <= 1 << 31, "TILE-SIZE", f"decoded_size {e.decoded_size}", where)
        need(e.vertices > 0, "TILE-VERTICES", "no vertex in a data tile", where)
        return e

    # ---- Tiles -----------------------------------------------------------------------------------

    def read_tile(self, e, tile_size, where):
        if e is None:
            return None
        if e.kind == CONSTANT:
            return ConstantTile(e.z_min, e.end_min)
        self.spend(e.decoded_size, where)
        stored = self.at(e.offset, e.stored_size)
        need(zlib.crc32(stored) == e.crc, "TILE-CRC", "the stored bytes are damaged", where)
        body = without_padding(stored, e.padding, "TILE-PADDING", where)
        if e.transform > 1:
            raise Unsupported(f"transform {e.transform}", where)
        data = decode(body, e.codec, e.decoded_size, "TILE-CODEC", where)
        pixels = tile_size[0] * tile_size[1]
        if e.transform == 0:
            table, colour, depths, planes = plain_tile(data, e, pixels, where)
        else:
            table, colour, depths, planes = delta_tile(data, e, tile_size[0], pixels, where)
        if colour:
            need(colour[-1] > 0, "TILE-FLAGS", "a coloured tile without a coloured pixel", where)
        need(SIGN not in depths, "DEPTH-ZERO", "a depth is -0", where)
        depths = numbers("f", u32_bytes(depths))
        planes = [visibilities(plane, e.lattice, where) for plane in planes]
        tile = DataTile(table, colour, depths, planes)
        check_tile(tile, e, where)
        return tile


def check_cover(ranges, begin, end, rule, where):
    for offset, size in sorted(ranges):
        need(
            offset == begin,
            rule,
            f"{'gap' if offset > begin else 'overlap'} at byte {min(offset, begin)}",
            where,
        )
        begin += size
    need(begin == end, rule, f"gap at byte {begin}", where)


def check_constant(e, data, pixels, where):
    """Section 6. Compares all bytes of the entry with those of the only valid entry."""
    expected = struct.pack(
        "<16xI4xffffB7x", pixels, e.z_min, e.z_min, e.end_min, e.end_min, CONSTANT
    )
    need(
        data == expected,
        "TILE-CONSTANT",
        "a field of a constant tile is not what it must be",
        where,
    )
    need(
        math.isfinite(e.z_min) and 0 <= e.end_min < 1,
        "TILE-CONSTANT",
        "depth or visibility out of range",
        where,
    )
    need(
        not same_f32(e.z_min, -0.0) and not same_f32(e.end_min, -0.0),
        "TILE-CONSTANT",
        "-0 occurs",
        where,
    )


# ---- Section 9: codecs ---------------------------------------------------------------------------


def without_padding(stored, padding, rule, where):
    need(padding <= len(stored), rule, f"padding {padding} of {len(stored)} bytes", where)
    body = stored[: len(stored) - padding]
    need(not any(stored[len(body) :]), rule, "padding is not zero", where)
    return body


def decode(body, codec, size, rule, where):
    """Decodes exactly `size` bytes; the caller must check `size` against the limits."""
    if codec == 0:
        data = body
    elif codec == 1:
        data = decode_lz4(body, size, rule, where)
    elif codec == 2:
        data = decode_zstd(body, size, rule, where)
    else:
        raise Unsupported(f"codec {codec}", where)
    need(len(data) == size, rule, f"{len(data)} bytes instead of {size}", where)
    return data[:size].ljust(size, b"\0")  # changes nothing, unless the rule is skipped


def decode_lz4(body, size, rule, where):
    """One LZ4 block, with the end conditions of section 9."""
    out, at, match = bytearray(), 0, None
    while at < len(body):
        token = body[at]
        count, at = lz4_length(body, at + 1, token >> 4, rule, where)
        need(at + count <= len(body), rule, "lz4: literals are cut off", where)
        out += body[at : at + count]
        at += count
        if at >= len(body):
            need(
                match is None or (count >= 5 and len(out) - match >= 12),
                rule,
                "lz4: too few literals after the last match",
                where,
            )
            return bytes(out)
        need(at + 2 <= len(body), rule, "lz4: an offset is cut off", where)
        offset, match = int.from_bytes(body[at : at + 2], "little"), len(out)
        need(1 <= offset <= match, rule, f"lz4: offset {offset} at byte {match}", where)
        count, at = lz4_length(body, at + 2, token & 15, rule, where)
        need(match + count + 4 <= size, rule, "lz4: too many bytes", where)
        pattern = out[match - offset :] if 1 <= offset <= match else b"\0"
        out += (pattern * ((count + 4) // len(pattern) + 1))[: count + 4]
    need(False, rule, "lz4: no literals after the last match", where)
    return bytes(out)


def lz4_length(body, at, length, rule, where):
    """The length that begins with four bits of a token, and the position after it."""
    more = 255 if length == 15 else 0
    while more == 255:
        need(at < len(body), rule, "lz4: a length is cut off", where)
        more = body[at]
        length, at = length + more, at + 1
    return length, at


def decode_zstd(body, size, rule, where):
    if zstandard is None:
        raise Unsupported("zstd: the package zstandard is not installed", where)
    if rule in where.skip:
        return raw_blocks(body)
    # The magic number rules out skippable frames and older formats.
    need(body[:4] == b"\x28\xb5\x2f\xfd", rule, "no zstd frame", where)
    try:
        frame = zstandard.get_frame_parameters(body)
        need(frame.dict_id == 0, rule, "a zstd frame with a dictionary", where)
        need(frame.content_size == size, rule, f"a zstd frame of another size than {size}", where)
        single_segment = body[4] & 0x20
        need(single_segment or frame.window_size <= 1 << 27, rule, "zstd: a large window", where)
        return zstandard.ZstdDecompressor().decompress(body, allow_extra_data=False)
    except (zstandard.ZstdError, ValueError) as error:
        raise Broken(rule, f"zstd: {error}", where) from None


def raw_blocks(body):
    """For tests: the content of a Zstandard frame of raw blocks, whatever its header says."""
    if body[1:4] == b"\x2a\x4d\x18":  # a skippable frame
        body = body[8 + int.from_bytes(body[4:8], "little") :]
    descriptor = body[4]
    single = descriptor >> 5 & 1
    at = 6 - single + (0, 1, 2, 4)[descriptor & 3] + (single, 2, 4, 8)[descriptor >> 6]
    out, last = b"", 0
    while at < len(body) and not last:
        head = int.from_bytes(body[at : at + 3], "little")
        out += body[at + 3 : at + 3 + (head >> 3)]
        at, last = at + 3 + (head >> 3), head & 1
    return out


# ---- Sections 7 and 8: tiles ---------------------------------------------------------------------
#
# plain_tile and delta_tile return the vertex table, the colour table or None, the depths as u32 bit
# patterns, and the visibility planes as u16 or u32.


class Parts:
    """Splits decoded bytes into consecutive parts."""

    def __init__(self, data, rule, where):
        self.data, self.rule, self.where, self.position = data, rule, where, 0

    def take(self, size):
        missing = size - (len(self.data) - self.position)
        need(missing <= 0, self.rule, "decoded_size is smaller than the parts", self.where)
        if missing > 64:
            raise Stuck("no such bytes")
        self.position += size
        return self.data[self.position - size : self.position].ljust(size, b"\0")

    def rest(self):
        return self.data[self.position :]


def u32_bytes(bits):
    """Little-endian bytes of u32 numbers."""
    bits = array("I", bits)
    if sys.byteorder == "big":
        bits.byteswap()
    return bits.tobytes()


def plain_tile(data, e, pixels, where):
    """Transform 0, section 7."""
    width = 2 if e.lattice else 4
    coloured = e.flags & 1
    least = (8 if coloured else 4) * (pixels + 1) + (4 + width) * e.vertices
    need(len(data) >= least, "TILE-SIZE", f"{len(data)} bytes for {e.vertices} vertices", where)
    parts = Parts(data, "TILE-SIZE", where)
    table = numbers("I", parts.take(4 * (pixels + 1)))
    colour = numbers("I", parts.take(4 * (pixels + 1))) if coloured else None
    typecode, width = ("H", 2) if e.lattice else ("I", 4)
    n, m = e.vertices, colour[-1] if colour else 0
    need(
        table[0] == 0 and table[-1] == n,
        "TILE-TABLE",
        f"goes from {table[0]} to {table[-1]}, not from 0 to {n}",
        where,
    )
    need(all(a <= b for a, b in zip(table, table[1:])), "TILE-TABLE", "falls", where)
    if colour:
        need(colour[0] == 0, "TILE-COLOUR", "does not begin with 0", where)
        for i in range(pixels):
            grows = colour[i + 1] - colour[i]
            need(
                grows in (0, table[i + 1] - table[i]),
                "TILE-COLOUR",
                f"grows by {grows} at pixel {i} of the tile",
                where,
            )
    depths = numbers("I", parts.take(4 * n))
    planes = [
        numbers(typecode, parts.take(width * count)) for count in ([n, m, m] if colour else [n])
    ]
    padding = parts.rest()
    need(
        len(padding) == -parts.position % 8,
        "TILE-SIZE",
        f"{len(padding)} bytes after the visibilities",
        where,
    )
    need(not any(padding), "TILE-PADDING", "padding is not zero", where)
    return table, colour, depths, planes


def delta_tile(data, e, width, pixels, where):
    """Transform 1, section 8."""
    parts, is_coloured = Parts(data, "TILE-STREAM", where), e.flags & 1
    word = 2 if e.lattice else 4
    counts = numbers("I", from_planes(parts.take(4 * pixels), 4))
    n = sum(counts)
    need(n == e.vertices, "TILE-VERTICES", f"{e.vertices} is not the sum of the counts, {n}", where)
    q = pixels - counts.count(0)
    coloured = take_bits(parts, pixels) if is_coloured else "0" * pixels
    need(
        not any(bit == "1" and not count for bit, count in zip(coloured, counts)),
        "TILE-STREAM",
        "colour bit of a pixel without vertices",
        where,
    )
    steps = take_bits(parts, n - q)
    firsts = numbers("I", from_planes(parts.take(4 * q), 4))
    gaps = numbers("I", from_planes(parts.take(4 * (n - q - steps.count("1"))), 4))
    need(0 not in gaps, "TILE-STREAM", "a gap is 0", where)
    colour_counts = [count if bit == "1" else 0 for bit, count in zip(coloured, counts)]
    m = sum(colour_counts)
    typecode = "H" if e.lattice else "I"
    drops = [
        numbers(typecode, from_planes(parts.take(word * count), word))
        for count in ([n, m, m] if is_coloured else [n])
    ]
    need(not parts.rest(), "TILE-STREAM", "bytes after the last part", where)
    planes = [
        undo_drops(d, c, e.lattice) for d, c in zip(drops, (counts, colour_counts, colour_counts))
    ]
    depths = undo_depths(counts, width, steps, firsts, gaps)
    return running_sum(counts), running_sum(colour_counts) if is_coloured else None, depths, planes


def take_bits(parts, count):
    bits = bits_of(parts.take((count + 7) // 8))
    need("1" not in bits[count:], "TILE-STREAM", "unused bits are not zero", parts.where)
    return bits[:count]


def running_sum(counts):
    table = array("I", [0])
    for count in counts:
        table.append(table[-1] + count)
    return table


def undo_depths(counts, width, steps, firsts, gaps):
    """Decodes parts 3 to 5 to depths, as f32 bit patterns."""
    first_of = [None] * len(counts)  # ordered first depths of the decoded pixels
    step, first, gap = iter(steps), iter(firsts), iter(gaps)
    ordered, before = array("I"), SIGN
    for pixel, count in enumerate(counts):
        if not count:
            continue
        stored = next(first)
        delta = (stored >> 1) ^ -(stored & 1)
        before = o = (prediction(first_of, pixel, width, before) + delta) & MASK
        first_of[pixel] = o
        ordered.append(o)
        for _ in range(count - 1):
            if next(step) == "0":
                o = (o + next(gap)) & MASK
            ordered.append(o)
    return array("I", (o ^ SIGN if o & SIGN else o ^ MASK for o in ordered))


def prediction(first_of, pixel, width, before):
    column = pixel % width
    left = first_of[pixel - 1] if column else None
    up = first_of[pixel - width] if pixel >= width else None
    left_up = first_of[pixel - width - 1] if column and pixel >= width else None
    if left is not None and up is not None and left_up is not None:
        return left + up - left_up
    return left if left is not None else up if up is not None else before


def undo_drops(drops, counts, lattice):
    """Decodes part 6 to the stored k (modulo 2^16) or to f32 bit patterns (modulo 2^32)."""
    one, mask, typecode = (lattice, 0xFFFF, "H") if lattice else (0x3F800000, MASK, "I")
    values, drop = array(typecode), iter(drops)
    for count in counts:
        value = one
        for _ in range(count):
            value = (value - next(drop)) & mask
            values.append(value)
    return values


def visibilities(plane, lattice, where):
    """The f32 values of stored visibilities."""
    if lattice:
        need(
            not plane or max(plane) <= lattice,
            "TILE-LATTICE",
            f"a visibility exceeds the lattice {lattice}",
            where,
        )
        return lattice_values(plane, lattice)
    need(SIGN not in plane, "DEPTH-ZERO", "a visibility is -0", where)
    return numbers("f", u32_bytes(plane))


# ---- Laws of the vertices (semantics.md, section 3) and ranges of the entry ----------------------


def check_tile(tile, e, where):
    ends = []
    for pixel in range(len(tile.table) - 1):
        depths, columns = tile.columns(pixel)
        if depths:
            check_laws(depths, columns, where.at(f"pixel {pixel} of the tile"))
            ends.extend(column[-1] for column in columns if column)
        else:
            ends.append(1.0)
    least, most = min(tile.depths, default=0.0), max(tile.depths, default=0.0)
    need(
        same_f32(e.z_min, least) and same_f32(e.z_max, most),
        "TILE-DEPTHS",
        f"{e.z_min} to {e.z_max} instead of {least} to {most}",
        where,
    )
    need(
        same_f32(e.end_min, min(ends)) and same_f32(e.end_max, max(ends)),
        "TILE-ENDS",
        f"{e.end_min} to {e.end_max} instead of {min(ends)} to {max(ends)}",
        where,
    )


def check_laws(depths, columns, where):
    need(all(map(math.isfinite, depths)), "DEPTH-FINITE", "a depth is not finite", where)
    need(all(a <= b for a, b in zip(depths, depths[1:])), "DEPTH-ORDER", "depths fall", where)
    need(
        len(depths) < 2 or depths[0] != depths[1],
        "DEPTH-FIRST",
        "two vertices at the first depth",
        where,
    )
    need(
        not any(a == b == c for a, b, c in zip(depths, depths[1:], depths[2:])),
        "DEPTH-PAIR",
        "three vertices at one depth",
        where,
    )
    for column in columns:
        need(
            all(0 <= v <= 1 for v in column),
            "VISIBILITY-RANGE",
            "a visibility is not from 0 to 1",
            where,
        )
        need(
            all(a >= b for a, b in zip(column, column[1:])),
            "VISIBILITY-RISE",
            "visibilities rise",
            where,
        )
    rows = list(zip(*columns))
    for i in range(1, len(rows)):
        need(
            depths[i - 1] < depths[i] or rows[i - 1] != rows[i],
            "VERTEX-STEP",
            f"no fall at vertex {i}",
            where,
        )
    before = (1.0,) * len(columns)
    for i, (row, after) in enumerate(zip(rows, rows[1:] + rows[-1:])):
        need(not before == row == after, "VERTEX-REDUNDANT", f"vertex {i}", where)
        before = row
    if len(columns) == 3:
        need(
            any(not r == g == b for r, g, b in rows),
            "COLOUR-EQUAL",
            "the three channels are equal everywhere",
            where,
        )


# ---- Section 5: footer ---------------------------------------------------------------------------


class Footer:
    def __init__(self, reader):
        self.reader, self.position = reader, 0
        self.missing = 0  # bytes beyond the end, if FOOTER-SHORT is skipped

    def take(self, size, where):
        need(
            size <= len(self.data) - self.position,
            "FOOTER-SHORT",
            "a record extends beyond the end of the footer",
            where,
        )
        part = self.data[self.position : self.position + size]
        self.position += len(part)
        return part

    def unpack(self, layout, where):
        size = struct.calcsize("<" + layout)
        part = self.take(size, where)
        self.missing += size - len(part)
        if self.missing > 64:
            raise Stuck("no such bytes")
        return struct.unpack("<" + layout, part.ljust(size, b"\0"))

    def read(self):
        r, where = self.reader, self.reader.where
        r.spend(r.footer_size, where.at("footer"))
        self.data = r.at(r.footer, r.footer_size)
        need(zlib.crc32(self.data) == r.footer_crc, "FOOTER-CRC", "the footer is damaged", where)
        # Checked first: an unknown feature may change the meaning of all other fields.
        (required,) = self.unpack("Q", where)
        if required:
            raise Unsupported(f"required features {required:#x}", where)
        optional, map_count, group_count, attribute_count, reserved = self.unpack("QIIII", where)
        need(1 <= map_count <= 65536, "MAP-COUNT", f"{map_count} maps", where)
        need(group_count <= 65536, "GROUP-COUNT", f"{group_count} groups", where)
        need(reserved == 0, "FOOTER-RESERVED", "reserved bytes are not zero", where)
        need(attribute_count <= 65536, "ATTRIBUTE-COUNT", f"{attribute_count} attributes", where)
        names = set()
        maps = [self.map(names, where.at(f"map {i}")) for i in range(map_count)]
        names = set()
        groups = [self.group(names, map_count, where.at(f"group {i}")) for i in range(group_count)]
        attributes = self.attributes(attribute_count, where.at("file"))
        rest = self.data[self.position :]
        need(
            len(rest) < 8 and not any(rest),
            "FOOTER-PADDING",
            f"{len(rest)} bytes after the records",
            where,
        )
        return File(
            required_features=required,
            optional_features=optional,
            maps=maps,
            groups=groups,
            attributes=attributes,
        )

    def name(self, rule, where):
        (length,) = self.unpack("H", where)
        need(1 <= length <= 255, rule, f"a name of {length} bytes", where)
        return self.text(self.take(length, where), rule, where, control=False)

    @staticmethod
    def text(data, rule, where, control=True):
        text = data.decode("utf-8", "replace")
        need(text.encode() == data, rule, "not UTF-8", where)
        need(
            control or not any(c < " " or c == "\x7f" for c in text),
            rule,
            "control characters",
            where,
        )
        return text

    def new_name(self, names, rule, where):
        name = self.name(rule, where)
        need(name not in names, rule, f"a second {name!a}", where)
        names.add(name)
        return name

    def map(self, names, where):
        """Section 5.1."""
        m = Map(name=self.new_name(names, "MAP-NAME", where))
        (
            m.width,
            m.height,
            m.channels,
            m.tile_log2,
            level_count,
            m.depth_kind,
            m.interpretation,
            m.camera_flags,
            reserved,
            m.depth_unit,
            *rest,
        ) = self.unpack("IIBBBBBBHd2i4iI", where)
        m.data_origin, m.display_window, attribute_count = (
            tuple(rest[:2]),
            tuple(rest[2:6]),
            rest[6],
        )
        need(
            1 <= m.width <= 1 << 20 and 1 <= m.height <= 1 << 20,
            "MAP-SIZE",
            f"{m.width}x{m.height}",
            where,
        )
        need(m.channels in (1, 3), "MAP-CHANNELS", f"{m.channels} channels", where)
        need(3 <= m.tile_log2 <= 8, "MAP-TILE", f"tile_log2 {m.tile_log2}", where)
        need(
            1 <= level_count <= 1 + (max(m.width, m.height) - 1).bit_length(),
            "MAP-LEVELS",
            f"{level_count} levels",
            where,
        )
        need(m.depth_kind <= 2, "MAP-DEPTH", f"depth_kind {m.depth_kind}", where)
        need(
            m.interpretation <= 2, "MAP-INTERPRETATION", f"interpretation {m.interpretation}", where
        )
        need(m.camera_flags <= 3, "MAP-CAMERA", f"camera_flags {m.camera_flags}", where)
        need(reserved == 0, "MAP-RESERVED", "reserved bytes are not zero", where)
        need(
            math.isfinite(m.depth_unit) and math.copysign(1, m.depth_unit) > 0,
            "MAP-UNIT",
            f"depth_unit {m.depth_unit}",
            where,
        )
        x0, y0, x1, y1 = m.display_window
        need(x0 <= x1 and y0 <= y1, "MAP-WINDOW", "the display window ends before it begins", where)
        need(attribute_count <= 65536, "ATTRIBUTE-COUNT", f"{attribute_count} attributes", where)
        m.worldToCamera = self.matrix(where) if m.camera_flags & 1 else None
        m.worldToNDC = self.matrix(where) if m.camera_flags & 2 else None
        m.levels = [self.level(m, i, where.at(f"level {i}")) for i in range(level_count)]
        m.attributes = self.attributes(attribute_count, where)
        return m

    def matrix(self, where):
        matrix = self.unpack("16d", where)
        need(all(map(math.isfinite, matrix)), "MAP-CAMERA", "a matrix is not finite", where)
        return matrix

    def level(self, m, index, where):
        """Section 5.2."""
        tile = 1 << m.tile_log2
        width, height = (
            (m.width + (1 << index) - 1) >> index,
            (m.height + (1 << index) - 1) >> index,
        )
        level = Level(
            index=index,
            width=width,
            height=height,
            tile=tile,
            tiles_x=-(-width // tile),
            tiles_y=-(-height // tile),
            entries=[],
            tiles=[],
        )
        level.max_error, level.vertices, level.payload_bytes = self.unpack("dQQ", where)
        need(
            0 <= level.max_error <= 1 and math.copysign(1, level.max_error) > 0,
            "LEVEL-ERROR",
            f"max_error {level.max_error}",
            where,
        )
        blocks = (level.tiles_x * level.tiles_y + ENTRIES_PER_BLOCK - 1) // ENTRIES_PER_BLOCK
        level.blocks = [self.block(where.at(f"block {b}")) for b in range(blocks)]
        return level

    def block(self, where):
        offset, stored_size, crc, codec, padding, *reserved = self.unpack("QIIBB6B", where)
        need(
            offset % 8 == 0
            and stored_size % 8 == 0
            and self.reader.directory <= offset
            and offset + stored_size <= self.reader.footer,
            "BLOCK-RANGE",
            f"offset {offset}, size {stored_size}",
            where,
        )
        need(padding <= 7, "BLOCK-PADDING", f"padding {padding}", where)
        need(not any(reserved), "BLOCK-RESERVED", "reserved bytes are not zero", where)
        return Record(offset=offset, stored_size=stored_size, crc=crc, codec=codec, padding=padding)

    def group(self, names, map_count, where):
        """Section 5.3."""
        name = self.new_name(names, "GROUP-NAME", where)
        role, count = self.unpack("BI", where)
        need(role in ROLES, "GROUP-ROLE", f"role {role}", where)
        need(1 <= count <= map_count, "GROUP-MAPS", f"{count} maps", where)
        maps = self.unpack(f"{count}I", where)
        need(
            all(m < map_count for m in maps) and len(set(maps)) == count,
            "GROUP-MAPS",
            "an index out of range, or twice",
            where,
        )
        return Record(name=name, role=role, maps=maps)

    def attributes(self, count, where):
        """Section 5.4."""
        names = set()
        return [self.attribute(names, where.at(f"attribute {i}")) for i in range(count)]

    def attribute(self, names, where):
        name = self.new_name(names, "ATTRIBUTE-NAME", where)
        kind, length = self.unpack("BI", where)
        value, rule, type_ = self.take(length, where), "ATTRIBUTE-VALUE", None
        if kind == 0:
            value = self.text(value, rule, where)
        elif kind in (1, 2):
            need(length and length % 8 == 0, rule, f"{length} bytes of numbers", where)
            value = struct.unpack_from(f"<{len(value) // 8}{'qd'[kind - 1]}", value)
        elif kind == 3:
            size = int.from_bytes(value[:2], "little")
            need(1 <= size <= 255 and 2 + size <= length, rule, "no name of a type", where)
            type_ = self.text(value[2 : 2 + size], rule, where, control=False)
            value = value[2 + size :]
        return Attribute(name=name, kind=kind, type=type_, value=value)


# ---- Section 10: content hash --------------------------------------------------------------------


def packed_name(name):
    data = name.encode()
    return struct.pack("<H", len(data)) + data


def content_hash(file):
    digest = hashlib.sha256(b"DSM-CONTENT-1\0\0\0" + struct.pack("<I", len(file.maps)))
    for m in file.maps:
        digest.update(packed_name(m.name))
        digest.update(
            struct.pack(
                "<IIBd2i4iB",
                m.width,
                m.height,
                m.depth_kind,
                m.depth_unit,
                *m.data_origin,
                *m.display_window,
                m.camera_flags,
            )
        )
        for matrix in (m.worldToCamera, m.worldToNDC):
            if matrix:
                digest.update(struct.pack("<16d", *matrix))
        digest.update(bytes([len(m.levels)]))
        for level in m.levels:
            hash_level(digest, level)
    digest.update(struct.pack("<I", len(file.groups)))
    for group in file.groups:
        digest.update(
            packed_name(group.name)
            + struct.pack(f"<BI{len(group.maps)}I", group.role, len(group.maps), *group.maps)
        )
    return digest.hexdigest()


def hash_level(digest, level):
    if level.width * level.height > MAX_HASHED_PIXELS:
        raise TooLarge(f"{level.width}x{level.height} pixels to hash")
    digest.update(struct.pack("<d", level.max_error))
    done = 0
    for x, y, (channels, depths, values) in level.functions():
        hash_empty(digest, y * level.width + x - done)
        digest.update(
            struct.pack(f"<IB{len(depths)}f{len(values)}f", len(depths), channels, *depths, *values)
        )
        done = y * level.width + x + 1
    hash_empty(digest, level.width * level.height - done)


def hash_empty(digest, count):
    """Hashes `count` pixels without vertices."""
    while count > 0:
        digest.update(struct.pack("<IB", 0, 1) * min(count, 4096))
        count -= 4096


# ---- The program ---------------------------------------------------------------------------------


@functools.lru_cache(maxsize=1 << 16)
def shortest(x):
    """The shortest decimal whose nearest f32 is x, in Python's notation without a trailing `.0`."""
    for digits in range(1, 10):
        texts = [f"{x:.{digits}g}"]
        # The f32 above a power of two is further away than the one below: try rounding up as well.
        if abs(math.frexp(x)[0]) == 0.5:
            up = decimal.Context(prec=digits, rounding=decimal.ROUND_UP)
            texts.append(str(up.create_decimal(decimal.Decimal(x))))
        for text in texts:
            if is_nearest(x, text):
                return repr(float(text)).removesuffix(".0")
    raise AssertionError("nine digits are enough for every f32")


def is_nearest(x, text):
    """Whether x is the f32 nearest to a decimal.

    Exact even where the f64 nearest to the decimal is a midpoint of two f32.
    """
    value = float(text)
    nearest = f32(value)
    other = 2 * value - nearest
    if value != nearest and f32(other) == other:
        side = Fraction(text) - Fraction(value)
        if side:
            return x == (max if side > 0 else min)(nearest, other)
    return x == nearest


def f32(value):
    try:
        return struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)


def dump(file, out):
    """Passes every decoded value to `out`, line by line, in ASCII without trailing spaces.

    The lines are: `dsm`; for each map `map`, `worldToCamera`, `worldToNDC`, its attributes, and for
    each level `level` and its pixels with vertices, row by row; then the groups; then the
    attributes of the file. A pixel is `pixel x,y mono z:v ...` or `pixel x,y rgb z:r,g,b ...` with
    `shortest` decimals. Names and text are JSON strings; opaque bytes are hexadecimal.
    """
    out(
        f"dsm 1 maps {len(file.maps)} groups {len(file.groups)} attributes {len(file.attributes)} "
        f"optional_features {file.optional_features:#x}"
    )
    for i, m in enumerate(file.maps):
        out(map_line(i, m))
        for name in ("worldToCamera", "worldToNDC"):
            if getattr(m, name):
                out(f"{name} {' '.join(map(repr, getattr(m, name)))}")
        for a in m.attributes:
            out(attribute_line(a))
        for level in m.levels:
            out(level_line(level))
            for x, y, (channels, depths, values) in level.functions():
                out(pixel_line(x, y, channels, depths, values))
    for i, g in enumerate(file.groups):
        out(f"group {i} {json.dumps(g.name)} {ROLES[g.role]} maps {' '.join(map(str, g.maps))}")
    for a in file.attributes:
        out(attribute_line(a))


def map_line(i, m):
    return (
        f"map {i} {json.dumps(m.name)} {m.width}x{m.height} channels {m.channels} "
        f"tile {1 << m.tile_log2} levels {len(m.levels)} depth {DEPTH_KINDS[m.depth_kind]} "
        f"unit {repr(m.depth_unit).removesuffix('.0')} "
        f"interpretation {INTERPRETATIONS[m.interpretation]} "
        f"origin {m.data_origin[0]},{m.data_origin[1]} "
        f"window {','.join(map(str, m.display_window))} attributes {len(m.attributes)}"
    )


def level_line(level):
    max_error = repr(level.max_error).removesuffix(".0")
    return f"level {level.index} {level.width}x{level.height} max_error {max_error}"


def pixel_line(x, y, channels, depths, values):
    vertices = []
    for i, z in enumerate(depths):
        row = values[i * channels : (i + 1) * channels]
        vertices.append(f"{shortest(z)}:{','.join(map(shortest, row))}")
    return f"pixel {x},{y} {'mono' if channels == 1 else 'rgb'} {' '.join(vertices)}"


def attribute_line(a):
    start = f"attribute {json.dumps(a.name)} "
    if a.kind == 0:
        return start + "text " + json.dumps(a.value)
    if a.kind in (1, 2):
        return start + ("i64 ", "f64 ")[a.kind - 1] + " ".join(map(repr, a.value))
    what = f"opaque {json.dumps(a.type)}" if a.kind == 3 else f"kind {a.kind}"
    return f"{start}{what} {a.value.hex()}".rstrip()


def summary(file, out):
    for i, m in enumerate(file.maps):
        out(map_line(i, m))
        for level in m.levels:
            kinds = [0, 0, 0]
            for entry in level.entries:
                kinds[entry.kind if entry else EMPTY] += 1
            out(
                f"{level_line(level)} vertices {level.vertices} "
                f"payload_bytes {level.payload_bytes} tiles {len(level.entries)} "
                f"(empty {kinds[0]}, constant {kinds[1]}, data {kinds[2]})"
            )
    out(f"groups {len(file.groups)} attributes {len(file.attributes)}")


def main(arguments):
    modes = [a for a in arguments if a in ("--verify", "--dump", "--hash")]
    paths = [a for a in arguments if not a.startswith("--")]
    if len(paths) != 1 or len(modes) > 1 or len(modes) + 1 != len(arguments):
        print("usage: reader.py [--verify | --dump | --hash] FILE", file=sys.stderr)
        return 2
    try:
        file, mode = read(paths[0]), modes[0] if modes else ""
        if mode == "--verify":
            print("good")
        elif mode == "--hash":
            print(content_hash(file))
        else:
            (dump if mode else summary)(file, print)
        return 0
    except Refused as refused:
        print(refused)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"cannot read {paths[0]}: {error.strerror}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

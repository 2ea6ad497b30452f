#!/usr/bin/env python3
"""Checks reader.py against the conformance vectors, or against the content hash of another reader.

  spec/check.py
      Every file of vectors/valid decodes to the text with its name, and every file of
      vectors/invalid is refused for the rule in its name.

  spec/check.py --dsm-info PROGRAM FILE ...
      Each FILE is sound, and reader.py computes the content hash that PROGRAM --hash prints.

Needs the standard library only. Skips files whose codec has no installed module; fails if it skips
more than half of the valid files.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

import reader

HERE = Path(__file__).parent


def tokens(text):
    """The words and numbers of a dump; numbers are floats, so that they compare by value."""
    for word in re.split(r"[ :,x\n]+", text):
        try:
            yield float(word)
        except ValueError:
            yield word


def dump(path):
    lines = []
    reader.dump(reader.read(path), lines.append)
    return "\n".join(lines)


def check_valid():
    skipped = 0
    files = sorted((HERE / "vectors" / "valid").glob("*.dsm"))
    for path in files:
        try:
            ours = list(tokens(dump(path)))
        except reader.Unsupported as e:
            print(f"skipped: {path.name}: {e}")
            skipped += 1
            continue
        theirs = list(tokens(path.with_suffix(".txt").read_text().rstrip("\n")))
        if ours != theirs:
            sys.exit(f"{path.name} does not decode to {path.stem}.txt")
    if not files or 2 * skipped > len(files):
        sys.exit(f"{skipped} of {len(files)} valid vectors were skipped")
    print(f"{len(files) - skipped} valid vectors decode to their texts")


def check_invalid():
    files = sorted((HERE / "vectors" / "invalid").glob("*.dsm"))
    for path in files:
        try:
            reader.read(path)
            sys.exit(f"{path.name} is accepted but must be refused")
        except reader.Broken as e:
            got = e.rule
        except reader.Unsupported:
            got = "unsupported"
        rule = re.match(r"[A-Z]+-[A-Z]+|unsupported", path.name)
        if not rule:
            sys.exit(f"{path.name} does not begin with a rule id")
        if got != rule[0] and not (got == "unsupported" and codec_is_missing()):
            sys.exit(f"{path.name} is refused for {got}")
    if not files:
        sys.exit("there are no invalid vectors")
    print(f"{len(files)} invalid vectors are refused for the rule in their name")


def codec_is_missing():
    """Whether a codec is missing: the reader may then refuse a file before it checks the rule."""
    return not (reader.zstandard and reader.lz4_block)


def check_hashes(program, files):
    for path in files:
        ours = reader.content_hash(reader.read(path))
        theirs = subprocess.run(
            [program, "--hash", path], capture_output=True, text=True, check=True
        ).stdout.strip()
        if ours != theirs:
            sys.exit(f"{path}: content hash {ours}, but {program} prints {theirs}")
    print(f"{len(files)} files have the content hash that {Path(program).name} prints")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dsm-info", metavar="PROGRAM")
    parser.add_argument("files", nargs="*", metavar="FILE")
    arguments = parser.parse_args()
    if bool(arguments.dsm_info) != bool(arguments.files):
        parser.error("--dsm-info and FILEs go together")
    if arguments.files:
        check_hashes(arguments.dsm_info, arguments.files)
    else:
        check_valid()
        check_invalid()


main()

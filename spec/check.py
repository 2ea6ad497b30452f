#!/usr/bin/env python3
"""Holds reader.py against the conformance vectors, and against files that another writer made.

  spec/check.py                       every file of vectors/valid decodes to the text beside it, every file of vectors/invalid is
                                      refused by the rule in its name
  spec/check.py --dsm-info PROGRAM FILE ...
                                      each FILE is sound, and PROGRAM --hash gives the content hash that reader.py computes

Standard library only; files of a codec that has no module here are counted as skipped, and at most half of them may be.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

import reader

HERE = Path(__file__).parent


def tokens(text):
    """Words and numbers of a dump; numbers compare as values."""
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
    print(f"{len(files) - skipped} valid vectors decode to the text beside them")


def check_invalid():
    files = sorted((HERE / "vectors" / "invalid").glob("*.dsm"))
    for path in files:
        try:
            reader.read(path)
            sys.exit(f"{path.name} is accepted")
        except reader.Broken as e:
            got = e.rule
        except reader.Unsupported:
            got = "unsupported"
        rule = re.match(r"[A-Z]+-[A-Z]+|unsupported", path.name)
        if not rule:
            sys.exit(f"{path.name} does not begin with a rule")
        if got != rule[0] and not (got == "unsupported" and needs_codec(path)):
            sys.exit(f"{path.name} is refused by {got}")
    if not files:
        sys.exit("there are no invalid vectors")
    print(f"{len(files)} invalid vectors are refused by the rule in their name")


def needs_codec(path):
    """Whether a missing module may stand between the reader and the rule."""
    return not (reader.zstandard and reader.lz4_block)


def check_hashes(program, files):
    for path in files:
        ours = reader.content_hash(reader.read(path))
        theirs = subprocess.run([program, "--hash", path], capture_output=True, text=True, check=True).stdout.strip()
        if ours != theirs:
            sys.exit(f"{path}: content hash {ours}, but {program} says {theirs}")
    print(f"{len(files)} files have the content hash that {Path(program).name} says")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
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

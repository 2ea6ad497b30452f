#!/usr/bin/env python3
"""Checks reader.py against the conformance vectors, or against the content hash of another reader.

  spec/check.py
      Every file of vectors/valid decodes to the text with its name. Every file of vectors/invalid
      is refused for the rule in its name, and is accepted if that rule alone is not checked.

  spec/check.py --dsm-info PROGRAM FILE ...
      Each FILE is sound, and reader.py computes the content hash that PROGRAM --hash prints.

Needs the standard library only. Skips files whose codec has no installed module; fails if it skips
more than half of the valid files.
"""

import argparse
import functools
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


def check_lookups():
    """Looks up the values that a `.lookups` file lists: at a depth, and just behind it."""
    files = sorted((HERE / "vectors" / "valid").glob("*.lookups"))
    for path in files:
        level = reader.read(path.with_suffix(".dsm")).maps[0].levels[0]
        for line in path.read_text().splitlines():
            pixel, z, *values = line.split()
            function = level.function(*map(int, pixel.split(",")))
            for text, behind in zip(values, (False, True), strict=True):
                ours = reader.visibility(function, reader.f32(float(z)), behind)
                theirs = tuple(map(float, text.split(",")))
                near = [abs(a - b) <= 2**-22 for a, b in zip(ours, theirs, strict=True)]
                if not all(near):
                    sys.exit(f"{path.name}: {line!r}: the value is {ours}")
    if not files:
        sys.exit("there are no lookups")
    print(f"the lookups of {len(files)} valid vectors give the listed values")


def verdict(data, skip=()):
    """The rule that refuses a file if the rules in `skip` are not checked, or another reason."""
    try:
        reader.read_bytes(data, skip)
        return "accepted"
    except reader.Broken as e:
        return e.rule
    except reader.Unsupported:
        return "unsupported"
    except reader.Refused:
        return "unreadable"


def rules_beside(data, rule):
    """The rules that refuse a file one after another, once `rule` is not checked.

    Ends with "unreadable" or "unsupported" if nothing can be read without these rules.
    """
    skip, beside = {rule}, []
    while (got := verdict(data, skip)) != "accepted":
        beside.append(got)
        if got in ("unreadable", "unsupported"):
            break
        skip.add(got)
    return beside


def rows_after(page, heading):
    """The cells of the table that follows a heading, as lists of the words in backticks."""
    text = page.split(heading, 1)[1]
    table = re.search(r"\n\|.*\n\|---.*\n((\|.*\n)*)", text)[1]
    words = functools.partial(re.findall, "`([^`]+)`")
    return [list(map(words, row.split("|"))) for row in table.splitlines()]


def check_invalid():
    """Each vector is refused for its rule; without that rule, only for those that README lists."""
    page = (HERE / "vectors" / "README.md").read_text()
    listed = {row[1][0]: row[2] for row in rows_after(page, "## Files that break several rules")}
    wrong, alone, rules, unsupported = [], set(), set(), 0
    files = sorted((HERE / "vectors" / "invalid").glob("*.dsm"))
    for path in files:
        data = path.read_bytes()
        name = re.match(r"([A-Z]+-[A-Z]+|unsupported)(-[a-z0-9-]+)?$", path.stem)
        if not name:
            sys.exit(f"{path.name} does not begin with a rule id")
        got, rule = verdict(data), name[1]
        if got == "unsupported" != rule and not reader.zstandard:
            print(f"skipped: {path.name}")
            continue
        if got != rule:
            wrong.append(f"{path.name}: {got}")
            continue
        if rule == "unsupported":
            unsupported += 1
            continue
        rules.add(rule)
        beside = rules_beside(data, rule)
        if beside != listed.pop(path.stem, []):
            wrong.append(f"{path.name} also breaks {' '.join(beside) or 'nothing'}")
        if not beside:
            alone.add(rule)
    wrong += [f"README.md lists {name}, which does not exist" for name in listed]
    all_rules = {row[1][0] for row in rows_after((HERE / "format.md").read_text(), "## 12. Rules")}
    never = {row[1][0] for row in rows_after(page, "## Rules that no file breaks alone")}
    wrong += [f"no vector breaks {rule}" for rule in all_rules - rules]
    if reader.zstandard and all_rules - alone != never:
        wrong.append(f"no vector breaks only {' '.join(sorted(all_rules - alone))}")
    if wrong:
        sys.exit("\n".join(wrong))
    print(
        f"{len(files)} invalid vectors are refused for the rule in their name, {unsupported} of "
        f"them as unsupported; {len(alone)} of {len(all_rules)} rules have a vector that no other "
        "rule refuses"
    )


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
        check_lookups()
        check_invalid()


main()

#!/usr/bin/env python3
"""Kills programs at random moments while they replace a file.

Each program runs over an existing file and gets SIGINT, SIGTERM or SIGKILL at a random moment.
Afterwards the file must be the old one, byte by byte, or the new one. After SIGINT and SIGTERM no
other file may remain. What remains after SIGKILL is counted, and must have a name from which the
output can be found.

    tests/kills.py --programs target/release             # 200 kills
    tests/kills.py --programs target/release --kills 30  # for CI
"""

import argparse
import hashlib
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]
OLD = b"the old file\n" * 50_000

# The program, its arguments, and its output, which is the last argument unless it follows -o.
CASES = [
    ("dsm-build", ["demo:hairball", "out.dsm", "--samples", "16", "--resolution", "192"]),
    ("dsm-convert", ["sample.exr", "out.dsm", "-z", "zstd:15"]),
    ("dsm-convert", ["in.dsm", "out.dsm", "--tolerance", "0.05"]),
    ("dsm-convert", ["in.dsm", "out.exr", "--float", "--tolerance", "0.02"]),
    ("dsm-convert", ["in.dsm", "out.npz"]),
    ("dsm-convert", ["in.dsm", "out.png", "--depth", "10", "--width", "4"]),
    ("dsm-convert", ["in.dsm", "flat.exr", "--opacity"]),
    ("dsm-join", ["merge", "in.dsm", "in.dsm", "out.dsm"]),
    ("dsm-join", ["stitch", "in.dsm", "out.dsm"]),
    ("dsm-join", ["collect", "in.dsm", "out.dsm"]),
    ("dsm-render", ["glass.toml", "out.png", "--no-shadows", "--resolution", "320x240"]),
    ("dsm-info", ["in.dsm", "--plot", "112,46", "-o", "plot.svg"]),
]


def output_of(arguments):
    if arguments[0] == "glass.toml":
        return arguments[1]
    return next(a for a in arguments[::-1] if a.startswith(("out.", "flat.", "plot.")))


def content(path):
    return hashlib.sha256(path.read_bytes()).digest()


def main():
    # A script may run this in the background, which ignores SIGINT, and programs inherit that.
    for ignored in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ignored, signal.SIG_DFL)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--programs", type=Path, required=True, help="folder of the programs")
    parser.add_argument("--kills", type=int, default=200, help="number of kills [default: 200]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", help="where the files are [default: a temporary folder]")
    args = parser.parse_args()
    programs = args.programs.resolve()
    dice = random.Random(args.seed)

    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        folder = Path(folder)
        inputs = {"sample.exr": "docs/sample.exr"}
        scenes = REPOSITORY / "docs/scenes"
        inputs |= {path.name: f"docs/scenes/{path.name}" for path in scenes.iterdir()}
        for name, path in inputs.items():
            (folder / name).write_bytes((REPOSITORY / path).read_bytes())

        def start(program, arguments):
            return subprocess.Popen(
                [programs / program, *arguments, "-q"],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )

        def whole(program, arguments):
            began = time.monotonic()
            process = start(program, arguments)
            _, error = process.communicate()
            if process.returncode != 0:
                sys.exit(f"{program} {' '.join(arguments)}: {error.decode()}")
            return time.monotonic() - began

        whole("dsm-convert", ["sample.exr", "in.dsm"])
        runs = []
        for program, arguments in CASES:
            path = folder / output_of(arguments)
            path.write_bytes(OLD)
            seconds = min(whole(program, arguments) for _ in range(2))
            runs.append((program, arguments, path, seconds, content(path)))
            path.unlink()
        old = hashlib.sha256(OLD).digest()
        usual = set(os.listdir(folder))

        counts = {s: dict(kills=0, ended=0, old=0, new=0, left=0, slowest=0.0) for s in SIGNALS}
        faults = []
        for i in range(args.kills):
            number = SIGNALS[i % len(SIGNALS)]
            program, arguments, path, seconds, new = runs[i // len(SIGNALS) % len(runs)]
            path.write_bytes(OLD)
            process = start(program, arguments)
            # A third of the kills aims at the end, where the file is published.
            earliest = 0.8 if dice.random() < 1 / 3 else 0.0
            time.sleep(seconds * dice.uniform(earliest, 1.1))
            process.send_signal(number)
            sent = time.monotonic()
            _, error = process.communicate()
            waited = time.monotonic() - sent
            ended, found = process.returncode, content(path)
            left = sorted(set(os.listdir(folder)) - usual - {path.name})
            about = f"{number.name} to {program} {' '.join(arguments)}"
            count = counts[number]
            count["kills"] += 1
            count["ended"] += ended == 0
            count["old"] += found == old
            count["new"] += found == new
            count["left"] += len(left)
            if ended == -number:
                count["slowest"] = max(count["slowest"], waited)
            if ended not in (0, -number):
                faults.append(f"{about}: it ended with {ended}: {error.decode()}")
            if found not in (old, new) or ended == 0 and found != new:
                faults.append(f"{about}: {path.name} is damaged")
            pattern = rf"\.({re.escape(path.name)}|scratch)\.[0-9a-f]{{8}}\.part"
            strange = [name for name in left if not re.fullmatch(pattern, name)]
            if strange or left and number != signal.SIGKILL:
                faults.append(f"{about}: it left {', '.join(left)}")
            for name in [path.name, *left]:
                (folder / name).unlink()

    print("signal   kills  ended before  old file  new file  files left  slowest end")
    for number, c in counts.items():
        print(
            f"{number.name:<8} {c['kills']:5} {c['ended']:13} {c['old']:9} {c['new']:9}"
            f" {c['left']:11} {c['slowest']:10.3f} s"
        )
    for fault in faults:
        print(fault)
    sys.exit(1 if faults else 0)


main()

#!/usr/bin/env python3
"""Counts messages per topic with the reference reader (Python package mcap) and with `insnav info`, and holds one against the
other; the files' CRCs are checked by both. Exit code 1 where they differ.

    python tests/validators/count_messages.py target/debug/insnav FILE-OR-FOLDER...

Needs the packages of requirements.txt beside this file.
"""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

from mcap.reader import NonSeekingReader


def by_reference(path):
    with open(path, "rb") as file:
        reader = NonSeekingReader(file, validate_crcs=True)
        # In the order of the file: the reader would otherwise sort by the index.
        messages = reader.iter_messages(log_time_order=False)
        return Counter(
            (channel.topic, schema.name if schema else "") for schema, channel, _ in messages
        )


def by_insnav(command, path):
    done = subprocess.run(
        [command, "info", str(path), "--format", "json"], capture_output=True, text=True
    )
    if done.returncode != 0:
        raise SystemExit(f"{path}: insnav info: {done.stderr}")
    topics = json.loads(done.stdout)["topics"]
    return Counter({(t["name"], t["schema"]): t["count"] for t in topics if t["count"]})


def main():
    command, *places = sys.argv[1:]
    files = [f for p in map(Path, places) for f in (sorted(p.glob("*.mcap")) if p.is_dir() else [p])]
    if not files:
        raise SystemExit("no files")
    messages, wrong = 0, 0
    for path in files:
        reference, ours = by_reference(path), by_insnav(command, path)
        messages += reference.total()
        for key in sorted(reference.keys() | ours.keys()):
            if reference[key] != ours[key]:
                wrong += 1
                print(f"{path}: {key}: {ours[key]}, mcap counts {reference[key]}")
    print(f"{len(files)} files, {messages} messages, {wrong} topics counted differently")
    return 1 if wrong or not messages else 0


if __name__ == "__main__":
    sys.exit(main())

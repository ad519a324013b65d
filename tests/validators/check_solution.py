#!/usr/bin/env python3
"""Reads a solution file with other people's programs: one line per program, exit code 1 if any of them objects.

    python tests/validators/check_solution.py SOLUTION.mcap

Needs the packages of requirements.txt beside this file.
"""

import importlib.metadata
import math
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

TOPICS = {
    "/insnav/odometry": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/insnav/pose": "geometry_msgs/msg/PoseStamped",
    "/insnav/fix": "sensor_msgs/msg/NavSatFix",
    "/insnav/state": "insnav_msgs/msg/State",
    "/insnav/updates": "insnav_msgs/msg/Update",
    "/insnav/withheld": "sensor_msgs/msg/NavSatFix",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}
# A run without withheld fixes, or without aiding, leaves these empty.
MAY_BE_EMPTY = {"/insnav/withheld", "/insnav/updates"}


class Objection(Exception):
    """A program read something else than it should."""


def require(condition, text):
    if not condition:
        raise Objection(text)


def with_mcap(path):
    """Every record, with the checksums of chunks, data section and summary; complete index; metadata."""
    from mcap.reader import make_reader
    from mcap.records import Message
    from mcap.stream_reader import StreamReader

    with open(path, "rb") as file:
        streamed = sum(isinstance(r, Message) for r in StreamReader(file, validate_crcs=True).records)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        require(reader.get_header().profile == "ros2", f"profile {reader.get_header().profile!r}")
        topics = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        require(topics == TOPICS, f"topics {topics}")
        last = 0
        indexed = 0
        for _, _, message in reader.iter_messages():
            require(message.log_time >= last, "log times go backward in the indexed reading")
            last = message.log_time
            indexed += 1
        require(indexed == streamed == summary.statistics.message_count, f"{indexed} indexed, {streamed} streamed")
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        require("version" in metadata.get("insnav", {}), f"metadata {metadata}")
    return f"{streamed} messages on {len(topics)} topics, checksums valid"


def with_mcap_ros2(path):
    """Every message decoded by its own schema text; stamps are log times; numbers are finite and sane."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    counts = Counter()
    transform = None
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] += 1
            head = decoded.transforms[0] if channel.topic == "/tf" else decoded
            stamp = head.header.stamp.sec * 10**9 + head.header.stamp.nanosec
            require(stamp == message.log_time, f"{channel.topic}: stamp {stamp}, log time {message.log_time}")
            if channel.topic == "/insnav/odometry":
                q = decoded.pose.pose.orientation
                norm = math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2)
                require(abs(norm - 1) < 1e-9, f"quaternion of norm {norm}")
                for covariance in (decoded.pose.covariance, decoded.twist.covariance):
                    for i in range(6):
                        require(covariance[7 * i] >= 0, f"variance {covariance[7 * i]} in a pose or twist")
                        for j in range(i):
                            a, b = covariance[6 * i + j], covariance[6 * j + i]
                            require(abs(a - b) <= 1e-9 * (1 + abs(a)), f"covariance not symmetric: {a}, {b}")
            elif channel.topic == "/tf":
                transform = (stamp, head.transform.translation, head.transform.rotation)
            elif channel.topic == "/insnav/pose":
                p, q = decoded.pose.position, decoded.pose.orientation
                require(transform is not None and transform[0] == stamp, "a pose without a transform of its instant")
                _, t, r = transform
                same = (p.x, p.y, p.z, q.x, q.y, q.z, q.w) == (t.x, t.y, t.z, r.x, r.y, r.z, r.w)
                require(same, f"pose and transform differ at {stamp}")
            elif channel.topic == "/insnav/state":
                require(abs(decoded.latitude_deg) <= 90 and 0 <= decoded.heading_deg <= 360, f"state {decoded}")
    missing = {topic for topic in TOPICS if not counts[topic]} - MAY_BE_EMPTY
    require(not missing, f"nothing on {sorted(missing)}")
    per_epoch = {counts[t] for t in ("/insnav/odometry", "/tf", "/insnav/pose", "/insnav/fix", "/insnav/state")}
    require(len(per_epoch) == 1, f"epochs differ between topics: {counts}")
    return f"{sum(counts.values())} messages decoded by their own schema texts"


def with_rosbags(path):
    """Every message decoded and encoded again gives the same bytes."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with tempfile.TemporaryDirectory() as folder:
        # rosbags wants a recording's folder with its description.
        bag = make_bag(Path(path), Path(folder))
        count = 0
        with AnyReader([bag]) as reader:
            for connection, _, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                again = bytes(reader.typestore.serialize_cdr(message, connection.msgtype))
                require(again == bytes(raw), f"{connection.topic}: re-serialised to other bytes")
                count += 1
        # Ours must also be the types that ROS itself ships, not just similar ones.
        store = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([bag]) as reader:
            known = 0
            for connection in reader.connections:
                if connection.msgtype in store.fielddefs:
                    own = reader.typestore.generate_msgdef(connection.msgtype, ros_version=2)
                    require(own == store.generate_msgdef(connection.msgtype, ros_version=2), f"{connection.msgtype} differs from ROS 2 Humble's")
                    known += 1
    return f"{count} messages re-serialised byte-equal, {known} topics of ROS 2 Humble's own types"


def make_bag(path, folder):
    import yaml
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    statistics = summary.statistics
    topics = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": summary.schemas[channel.schema_id].name,
                "serialization_format": "cdr",
                "offered_qos_profiles": "",
            },
            "message_count": statistics.channel_message_counts.get(identifier, 0),
        }
        for identifier, channel in summary.channels.items()
    ]
    duration = statistics.message_end_time - statistics.message_start_time
    information = {
        "version": 5,
        "storage_identifier": "mcap",
        "relative_file_paths": ["solution.mcap"],
        "duration": {"nanoseconds": duration},
        "starting_time": {"nanoseconds_since_epoch": statistics.message_start_time},
        "message_count": statistics.message_count,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "files": [
            {
                "path": "solution.mcap",
                "starting_time": {"nanoseconds_since_epoch": statistics.message_start_time},
                "duration": {"nanoseconds": duration},
                "message_count": statistics.message_count,
            }
        ],
    }
    (folder / "solution.mcap").symlink_to(path.resolve())
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    return folder


def run(command, **environment):
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment})
    text = (done.stdout + done.stderr).strip()
    require(done.returncode == 0, f"{' '.join(map(str, command))}: exit code {done.returncode}: {text[-800:]}")
    return text


def script(name):
    """A command that a package installed beside this interpreter."""
    return str(Path(sys.executable).with_name(name))


def with_evo(path):
    """evo's trajectory command in its mcap mode reads odometry and pose as the same trajectory, and finds it sound.

    Its reading of tf needs ROS itself; that tf says the same as pose is checked with mcap-ros2-support.
    """
    read = {}
    with tempfile.TemporaryDirectory() as home:
        for topic in ("/insnav/odometry", "/insnav/pose"):
            text = run([script("evo_traj"), "mcap", str(path), topic, "--full_check"], HOME=home, MPLBACKEND="Agg")
            sections = {}
            rows = {}
            for line in text.splitlines():
                if line.endswith(":") and not line.startswith("\t"):
                    rows = sections.setdefault(line[:-1], {})
                elif line.startswith("\t") and line.count("\t") == 2:
                    key, value = line[1:].split("\t")
                    rows[key] = value
            checks = sections.get("checks", {})
            require(checks and set(checks.values()) <= {"yes", "ok"}, f"{topic}: checks {checks} in {text[-800:]}")
            read[topic] = {key: sections["infos"][key] for key in ("nr. of poses", "path length (m)", "duration (s)")}
    first = read["/insnav/odometry"]
    require(all(other == first for other in read.values()), f"the topics differ: {read}")
    return f"odometry and pose are one trajectory of {first['nr. of poses']} poses, {float(first['path length (m)']):.0f} m"


def with_rerun(path):
    """rerun's own check of an MCAP: order on every timeline of every topic."""
    text = run([script("rerun"), "mcap", "check", "--full", str(path)])
    rows = [line.split() for line in text.splitlines() if " /" in line and line.split()[1].isdigit()]
    require(rows, f"no table in {text[-800:]}")
    bad = [" ".join(row) for row in rows if row[0] != "ok"]
    require(not bad, f"{bad}")
    return f"{len(rows)} topics without issues on all timelines"


VALIDATORS = [
    ("mcap", with_mcap),
    ("mcap-ros2-support", with_mcap_ros2),
    ("rosbags", with_rosbags),
    ("evo", with_evo),
    ("rerun-sdk", with_rerun),
]


def main():
    if len(sys.argv) != 2:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    failures = 0
    for package, check in VALIDATORS:
        name = f"{package} {importlib.metadata.version(package)}"
        try:
            print(f"ok   {name}: {check(sys.argv[1])}", flush=True)
        except Exception as error:  # Whatever a program objects with is its verdict.
            failures += 1
            print(f"FAIL {name}: {type(error).__name__}: {error}", flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

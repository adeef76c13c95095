#!/usr/bin/env python3
"""Do other people's readers see in an MCAP stream what the CSV of the same records says?

    check.py STREAM.mcap [--scan FILE] [--imu FILE] [--lines FILE] [--segments FILE] [--pose FILE]
             [--truth FILE] [--desired FILE] [--clock FILE]

STREAM.mcap is what a pipeline wrote with `--format mcap` (`-o STREAM.mcap` or through a pipe);
every FILE is the CSV of the same records, from the same run with `--format csv`.

Every topic is decoded three times: with mcap + mcap-ros2-support from the file, with the same from
a pipe, and with rosbags. The values are compared with the CSV: our own types and all positions
exactly, float32 fields as the float32 of the CSV's value, rotations and covariances with formulas
of this script's own. A topic of a kind whose CSV is not given is only decoded. Prints one line a
failure and at the end `N passed, N failed`; the exit status is 1 if anything failed.

Needs the packages of requirements.txt beside this file.
"""

import argparse
import csv
import math
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

csv.field_size_limit(1 << 24)

# A missing stamp and a missing count in our own types, which have no empty field.
MISSING_INTS = (-(2**63), -1)
UNKNOWN_VARIANCE = 1e9


class Difference(Exception):
    """What a message says and the CSV does not."""


def read_csv(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(row for row in file if not row.startswith("#")))


def with_mcap(reader):
    topics = defaultdict(list)
    for _, channel, message, decoded in reader.iter_decoded_messages():
        topics[channel.topic].append((message.log_time, message.publish_time, decoded))
    return topics


def from_file(path):
    with open(path, "rb") as file:
        return with_mcap(make_reader(file, decoder_factories=[DecoderFactory()]))


def from_pipe(path):
    with subprocess.Popen(["cat", path], stdout=subprocess.PIPE) as cat:
        return with_mcap(NonSeekingReader(cat.stdout, decoder_factories=[DecoderFactory()]))


def from_rosbags(path):
    topics = defaultdict(list)
    with AnyReader([Path(path)]) as reader:
        for connection, time, raw in reader.messages():
            decoded = reader.deserialize(raw, connection.msgtype)
            topics[connection.topic].append((time, None, decoded))
    return topics


READERS = {
    "mcap, file": from_file,
    "mcap, pipe": from_pipe,
    "rosbags": from_rosbags,
}


def number(text):
    return float(text) if text else math.nan


def numbers(row, *columns):
    return np.array([number(row.get(column, "")) for column in columns])


def require(what, ok, found, wanted):
    if not ok:
        raise Difference(f"{what}: {found!r} where the CSV has {wanted!r}")


def exactly(what, found, wanted):
    require(what, np.array_equal(found, wanted, equal_nan=True), found, wanted)


def closely(what, found, wanted, tolerance=1e-12):
    found, wanted = np.asarray(found), np.asarray(wanted)
    same_nan = np.array_equal(np.isnan(found), np.isnan(wanted))
    known = ~np.isnan(wanted)
    close = same_nan and np.all(np.abs(found[known] - wanted[known]) <= tolerance)
    require(what, close, found, wanted)


def same_field(name, found, text):
    """One field of a type of our own against a CSV field."""
    if isinstance(found, str):
        require(name, found == text, found, text)
    elif isinstance(found, (int, np.integer)):
        ok = int(found) == int(text) if text else int(found) in MISSING_INTS
        require(name, ok, found, text)
    elif isinstance(found, (float, np.floating)):
        exactly(name, float(found), number(text))
    else:
        items = text.split(" ") if text else []
        require(f"length of {name}", len(found) == len(items), len(found), len(items))
        for item, wanted in zip(found, items):
            same_field(name, item.item() if hasattr(item, "item") else item, wanted)


def fields(message):
    """Names of a message's fields, for either reader's classes."""
    names = getattr(message, "__slots__", None) or getattr(message, "__dataclass_fields__")
    return [name.lstrip("_") for name in names if not name.startswith("__")]


def stamp_ns(header):
    stamp = header.stamp
    nanosec = stamp.nanosec
    return int(stamp.sec) * 1_000_000_000 + int(nanosec)


def xyz(v):
    return np.array([v.x, v.y, v.z])


def rotation(roll, pitch, yaw):
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return rz @ ry @ rx


def matrix(q):
    """The rotation matrix of a unit quaternion."""
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


STATE = ["x", "y", "z", "roll", "pitch", "yaw"]
POSITION = ["x_m", "y_m", "z_m"]
ATTITUDE = ["roll_rad", "pitch_rad", "yaw_rad"]


def fixed_axes(row):
    """The CSV's covariance carried to rotations about the fixed axes x, y, z."""
    c = np.empty((6, 6))
    for i in range(6):
        for j in range(i, 6):
            c[i, j] = c[j, i] = number(row.get(f"cov_{STATE[i]}_{STATE[j]}", ""))
    _, pitch, yaw = numbers(row, *ATTITUDE)
    a = np.eye(6)
    # Columns: where the axes of roll, pitch and yaw point.
    a[3:, 3] = rotation(0, pitch, yaw) @ [1, 0, 0]
    a[3:, 4] = rotation(0, 0, yaw) @ [0, 1, 0]
    return a @ c @ a.T


def check_own(message, row):
    known = fields(message)
    for name in known:
        same_field(name, getattr(message, name), row.get(name, "") or "")
    return known


def check_scan(message, row, ranges="ranges_mm", remissions="remissions"):
    exactly("stamp", stamp_ns(message.header), int(row["stamp_ns"]))
    require("frame", message.header.frame_id == "laser", message.header.frame_id, "laser")
    for field, column in [
        ("angle_min", "angle_min_rad"),
        ("angle_increment", "angle_increment_rad"),
        ("time_increment", "time_increment_s"),
        ("scan_time", "scan_time_s"),
        ("range_min", "range_min_m"),
        ("range_max", "range_max_m"),
    ]:
        exactly(field, np.float32(getattr(message, field)), np.float32(number(row[column])))
    millimetres = np.array((row.get(ranges) or "").split(), dtype=float)
    exactly("ranges", np.float32(message.ranges), np.float32(millimetres / 1000))
    digits = np.array((row.get(remissions) or "").split(), dtype=np.float32)
    exactly("intensities", np.float32(message.intensities), digits)


def check_echo(k):
    return lambda message, row: check_scan(message, row, f"ranges_{k}_mm", f"remissions_{k}")


def check_imu(message, row):
    exactly("stamp", stamp_ns(message.header), int(row["stamp_ns"]))
    attitude = numbers(row, *ATTITUDE)
    if np.isnan(attitude[:2]).all():
        exactly("orientation_covariance[0]", message.orientation_covariance[0], -1.0)
    else:
        heading = message.orientation_covariance[8] < UNKNOWN_VARIANCE
        require("heading known", heading == (not math.isnan(attitude[2])), heading, attitude[2])
        wanted = rotation(*np.nan_to_num(attitude))
        closely("orientation", matrix(message.orientation), wanted)
    for field, columns in [
        ("angular_velocity", ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"]),
        ("linear_acceleration", ["accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"]),
    ]:
        wanted = numbers(row, *columns)
        if np.isnan(wanted).all():
            exactly(f"{field}_covariance[0]", getattr(message, f"{field}_covariance")[0], -1.0)
        else:
            exactly(field, xyz(getattr(message, field)), np.nan_to_num(wanted))


MAGNETIC = ["mag_x_gauss", "mag_y_gauss", "mag_z_gauss"]


def check_mag(message, row):
    exactly("stamp", stamp_ns(message.header), int(row["stamp_ns"]))
    closely("magnetic_field", xyz(message.magnetic_field), numbers(row, *MAGNETIC) * 1e-4, 1e-18)


def check_pose(message, row):
    exactly("stamp", stamp_ns(message.header), int(row["stamp_ns"]))
    pose = message.pose.pose
    exactly("position", xyz(pose.position), numbers(row, *POSITION))
    closely("orientation", matrix(pose.orientation), rotation(*numbers(row, *ATTITUDE)))
    found = np.reshape(message.pose.covariance, (6, 6))
    wanted = fixed_axes(row)
    closely("covariance", found, wanted, 1e-12 * max(np.nanmax(np.abs(wanted), initial=0), 1e-9))


def check_tf(message, row):
    (transform,) = message.transforms
    exactly("stamp", stamp_ns(transform.header), int(row["stamp_ns"]))
    names = (transform.header.frame_id, transform.child_frame_id)
    require("frames", names == ("frame", "platform"), names, ("frame", "platform"))
    exactly("translation", xyz(transform.transform.translation), numbers(row, *POSITION))
    turned = matrix(transform.transform.rotation)
    closely("rotation", turned, rotation(*numbers(row, *ATTITUDE)))


def check_odometry(message, row):
    exactly("stamp", stamp_ns(message.header), int(row["stamp_ns"]))
    exactly("position", xyz(message.pose.pose.position), numbers(row, *POSITION))
    r = rotation(*numbers(row, *ATTITUDE))
    closely("orientation", matrix(message.pose.pose.orientation), r)
    velocity = numbers(row, "vx_m_s", "vy_m_s", "vz_m_s")
    if np.isnan(velocity).any():
        exactly("twist covariance", message.twist.covariance[0], UNKNOWN_VARIANCE)
    else:
        closely("twist, in the child's axes", xyz(message.twist.twist.linear), r.T @ velocity)


def solved(row):
    components = numbers(row, *POSITION, *ATTITUDE)
    return bool(np.isfinite(components).all()) and "no-pose" not in row.get("status", "")


def has_any(*columns):
    return lambda row: any(row.get(column) for column in columns)


def always(_):
    return True


# Topic: the CSV it is compared with, which of its rows have a message, and the comparison.
TOPICS = {
    "/scan_info": ("scan", always, check_own),
    "/scan": ("scan", always, check_scan),
    "/imu_info": ("imu", always, check_own),
    "/imu": ("imu", always, check_imu),
    "/mag": ("imu", has_any(*MAGNETIC), check_mag),
    "/lines": ("lines", always, check_own),
    "/segments": ("segments", always, check_own),
    "/pose_status": ("pose", always, check_own),
    "/pose": ("pose", solved, check_pose),
    "/tf": ("pose", solved, check_tf),
    "/truth_info": ("truth", always, check_own),
    "/truth": ("truth", always, check_odometry),
    "/desired_info": ("desired", always, check_own),
    "/desired": ("desired", always, check_odometry),
    "/clock_exchange": ("clock", always, check_own),
}
for echo in range(2, 6):
    rows_with = has_any(f"ranges_{echo}_mm", f"remissions_{echo}")
    TOPICS[f"/scan_echo{echo}"] = ("scan", rows_with, check_echo(echo))

KINDS = ["scan", "imu", "lines", "segments", "pose", "truth", "desired", "clock"]


def check_statics(topics):
    """The laser's frame has x = y of S, y = z of S, z = x of S, and the frame is drawn."""
    for _, _, message in topics.get("/tf_static", []):
        for transform in message.transforms:
            names = (transform.header.frame_id, transform.child_frame_id)
            require("frames", names == ("platform", "laser"), names, ("platform", "laser"))
            turned = matrix(transform.transform.rotation)
            closely("det of the laser's rotation", np.linalg.det(turned), 1.0)
            # Mountings are within a few degrees of straight.
            closely("laser", turned, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], 0.3)
    for _, _, message in topics.get("/markers", []):
        require("markers", len(message.markers) > 0, len(message.markers), "some")


def check_topic(topic, messages, rows):
    kind, wanted, compare = TOPICS[topic]
    rows = [row for row in rows if wanted(row)]
    require("number of messages", len(messages) == len(rows), len(messages), len(rows))
    for i, ((_, published, message), row) in enumerate(zip(messages, rows), start=1):
        try:
            compare(message, row)
            if published is not None and "stamp_ns" in row:
                exactly("publish_time", published, int(row["stamp_ns"]))
        except Difference as difference:
            raise Difference(f"message {i}: {difference}") from None


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("stream", metavar="STREAM.mcap")
    for kind in KINDS:
        parser.add_argument(f"--{kind}", metavar="FILE")
    args = parser.parse_args()
    tables = {kind: read_csv(path) for kind in KINDS if (path := getattr(args, kind))}
    passed = failed = 0

    def run(name, check):
        nonlocal passed, failed
        try:
            result = check()
            passed += 1
            return result
        except Exception as error:  # Whatever a foreign reader throws is a failure to report.
            failed += 1
            print(f"{args.stream}: {name}: {type(error).__name__}: {error}")
            return None

    for reader, read in READERS.items():
        topics = run(f"{reader}: reading", lambda: read(args.stream))
        if topics is None:
            continue
        run(f"{reader}: /tf_static, /markers", lambda: check_statics(topics))
        for topic, (kind, wanted, _) in TOPICS.items():
            rows = tables.get(kind)
            if rows is None or (topic not in topics and not any(map(wanted, rows))):
                continue
            run(f"{reader}: {topic}", lambda: check_topic(topic, topics.get(topic, []), rows))
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

"""A second decoder of SCIP 2.0 that shares no code with the kit: reads the raw bytes that
scan-capture --device hokuyo kept (--tee) and compares every scan with the CSV records.

    python3 scip_check.py run.scip scans.csv

Written from the protocol's description alone; only the standard library is used.
"""

import csv
import math
import sys


def fail(text):
    print(f"scip_check: {text}", file=sys.stderr)
    sys.exit(1)


def checked(line):
    text, check = line[:-1], line[-1]
    if (sum(text) & 0x3F) + 0x30 != check:
        fail(f"check character of {line!r}")
    return text


def number(characters):
    value = 0
    for character in characters:
        value = value * 64 + character - 0x30
    return value


def parameters(lines):
    found = {}
    for line in lines:
        text = line[:-2]
        if (sum(text) & 0x3F) + 0x30 != line[-1] or line[-2:-1] != b";":
            fail(f"line of PP: {line!r}")
        key, value = text.decode("ascii").split(":", 1)
        found[key] = value
    return {key: int(found[key]) for key in "DMIN DMAX ARES AMIN AMAX AFRT SCAN".split()}


def main():
    raw = open(sys.argv[1], "rb").read()
    rows = list(csv.DictReader(open(sys.argv[2], newline="")))
    pp, scans = None, []
    for reply in raw.split(b"\n\n"):
        lines = reply.strip(b"\n").split(b"\n")
        if len(lines) < 2:
            continue
        echo, status = lines[0], checked(lines[1])
        if echo == b"PP":
            pp = parameters(lines[2:])
        if status != b"99":
            continue
        if not echo.startswith(b"ME"):
            fail(f"not asked for intensities: {echo!r}")
        data = b"".join(checked(line) for line in lines[3:])
        values = [number(data[at : at + 3]) for at in range(0, len(data), 3)]
        scans.append((number(checked(lines[2])), values[0::2], values[1::2]))
    if pp is None:
        fail("no PP reply")
    if not rows or len(scans) < len(rows):
        fail(f"{len(scans)} scans in the bytes, {len(rows)} records")
    step = math.tau / pp["ARES"]
    first = math.pi / 2 + (pp["AMIN"] - pp["AFRT"]) * step
    for (stamp, distances, intensities), row in zip(scans, rows):
        if len(distances) != pp["AMAX"] - pp["AMIN"] + 1:
            fail(f"{len(distances)} distances")
        ranges = row["ranges_mm"].split(" ")
        for ours, theirs in zip(distances, ranges, strict=True):
            if ours == 1 or ours > pp["DMAX"]:
                wanted = math.inf
            elif ours == 2:
                wanted = -math.inf
            elif ours < pp["DMIN"]:
                wanted = math.nan
            else:
                wanted = ours
            found = float(theirs)
            if found != wanted and not (math.isnan(found) and math.isnan(wanted)):
                fail(f"stamp {stamp}: {theirs} mm, {wanted} in the bytes")
        if [float(text) for text in row["remissions"].split(" ")] != intensities:
            fail(f"stamp {stamp}: intensities differ")
        if int(row["device_ns"]) // 1_000_000 % (1 << 24) != stamp:
            fail(f"stamp {stamp}: device_ns {row['device_ns']}")
        if abs(float(row["angle_min_rad"]) - first) > 1e-9:
            fail(f"angle_min_rad {row['angle_min_rad']}, not {first}")
        if abs(float(row["angle_increment_rad"]) - step) > 1e-12:
            fail(f"angle_increment_rad {row['angle_increment_rad']}, not {step}")
    beams = sum(len(distances) for _, distances, _ in scans[: len(rows)])
    print(f"scip_check: {len(rows)} scans, {beams} distances and intensities agree")


main()

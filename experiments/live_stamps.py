"""Puts a trajectory that an emulated device wrote by its own clock onto the host's.

    live_stamps.py POSES.csv TRAJECTORY.csv OUT.csv

Row k of the trajectory is for scan k, at the instant that its pose is for; the poses' stamps say when that was for
the host. Their seq counts scans, and the first pose is that of the first scan. The offset is the median over all.
"""

import csv
import statistics
import sys


def main():
    poses_name, name, out = sys.argv[1:]
    with open(poses_name) as file:
        poses = [(int(row["seq"]), int(row["stamp_ns"])) for row in csv.DictReader(file)]
    with open(name) as file:
        header, *rows = csv.reader(file)
    first = poses[0][0]
    pairs = ((seq - first, stamp) for seq, stamp in poses)
    offsets = [stamp - int(rows[k][0]) for k, stamp in pairs if 0 <= k < len(rows)]
    offset = round(statistics.median(offsets))
    with open(out, "w") as file:
        print(",".join(header), file=file)
        for row in rows:
            print(int(row[0]) + offset, *row[1:], sep=",", file=file)


main()

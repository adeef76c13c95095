"""The delay in whole scans that leaves the least rms of y, as it is found by hand from plots.

    by_hand.py DESIRED.csv POSES.csv

Prints it as timesync delay --json does: delay_s, sigma_s (of what lies between two scans).
"""

import bisect
import csv
import json
import math
import statistics
import sys


def read(path):
    with open(path) as file:
        rows = ((int(row["stamp_ns"]), row["y_m"]) for row in csv.DictReader(file))
        return [(stamp, float(y)) for stamp, y in rows if y]


def main():
    desired, poses = read(sys.argv[1]), read(sys.argv[2])
    stamps = [stamp for stamp, _ in desired]
    step_ns = statistics.median(b - a for a, b in zip(stamps, stamps[1:]))

    def at(stamp):
        i = min(max(bisect.bisect(stamps, stamp), 1), len(stamps) - 1)
        (t0, y0), (t1, y1) = desired[i - 1], desired[i]
        return y0 + (y1 - y0) * min(max((stamp - t0) / (t1 - t0), 0), 1)

    def left(scans):
        return math.sqrt(statistics.fmean((y - at(stamp - scans * step_ns)) ** 2 for stamp, y in poses))

    best = min(range(-6, 7), key=left)
    print(json.dumps({"delay_s": best * step_ns * 1e-9, "sigma_s": step_ns * 1e-9 / math.sqrt(12)}))


main()

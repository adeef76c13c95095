"""Over which yaw the reflectors on the walls are hit: Kurniawan 2017, eq. 3.104, beside scans.

    yaw_range.py FRAME.toml OUT.csv

tan(yaw) = 0.5 w / d, d the distance to the further wall along y, x = 0, no pitch. For every y the yaw
is raised in steps until a wall is no longer found. Programs are taken from PATH. Leaves what it prints in OUT.csv
too. Ends with status 4 where scans and formula differ by more than two steps.
"""

import csv
import io
import math
import subprocess
import sys
import tomllib
from pathlib import Path

STEP_DEG = 0.05


def walls(frame, yaw_deg):
    """Of every y whether both walls were found."""
    command = (
        f"simulate -q -f {frame} --effects none --trajectory grid --y-range=-4,4 --z-range 2,2 --step-m 1"
        f" --grid-pose 0,0,0,{yaw_deg:.3f} | extract-lines -q -f {frame} --cold"
    )
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    rows = csv.DictReader(io.StringIO(done.stdout))
    return [int(row["right_points"]) > 0 and int(row["left_points"]) > 0 for row in rows]


def main():
    frame = Path(sys.argv[1])
    content = tomllib.loads(frame.read_text())
    half_m = content["box"]["dy_m"] / 2
    plate = content["plate"][0]["x_m"]
    width_m = plate[1] - plate[0]
    ys = [-4.0 + k for k in range(9)]
    last = [0.0] * len(ys)
    for k in range(1, int(6 / STEP_DEG)):
        found = walls(frame, k * STEP_DEG)
        if not any(found):
            break
        for i, both in enumerate(found):
            if both and last[i] == (k - 1) * STEP_DEG:
                last[i] = k * STEP_DEG
    missed = False
    out = open(sys.argv[2], "w")
    print("y_m,formula_deg,scans_deg", file=out)
    print(f"{'y m':>6}{'eq. 3.104 deg':>15}{'scans deg':>11}")
    for y, seen in zip(ys, last):
        formula = math.degrees(math.atan(0.5 * width_m / (half_m + abs(y))))
        bad = not formula - 2 * STEP_DEG <= seen <= formula + STEP_DEG
        missed |= bad
        print(f"{y:.1f},{formula:.3f},{seen:.2f}", file=out)
        print(f"{y:>6.1f}{formula:>15.3f}{seen:>11.2f}{'  MISSED' if bad else ''}")
    sys.exit(4 if missed else 0)


main()

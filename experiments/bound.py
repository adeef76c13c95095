"""What a single scan can tell of the pose at best over the feasible workspace, as JSON: the root mean square of the
least standard deviations on a grid, with remissions and with ranges only.

    bound.py FRAME.toml

`simulate` is taken from PATH. The pitch is known; x is 0 and the platform level, as in the dissertation's figures.
"""

import csv
import json
import math
import subprocess
import sys


def bound(frame, effects):
    command = ["simulate", "-q", "-f", frame, "--dilution", "--effects", effects, "--z-range", "0.5,4"]
    command += ["--step-m", "0.25", "--x-range=0,0", "--tilt-deg", "0"]
    table = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows = list(csv.DictReader(table.splitlines()))

    def rms(column, scale):
        return scale * math.sqrt(sum(float(row[column]) ** 2 for row in rows) / len(rows))

    figures = {f"{axis}_rms_mm": rms(f"{axis}_sigma_m", 1e3) for axis in "xyz"}
    for angle in ("roll", "yaw"):
        figures[f"{angle}_rms_deg"] = rms(f"{angle}_sigma_rad", math.degrees(1))
    return figures


def main():
    frame = sys.argv[1]
    effects = {"remission": "reference", "ranges": "reference,-remission"}
    print(json.dumps({name: bound(frame, list_) for name, list_ in effects.items()}, indent=1))


main()

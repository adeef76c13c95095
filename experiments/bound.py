"""What a single scan can tell of the pose at best over the feasible workspace, as JSON: the root mean square of the
least standard deviations on a grid, with remissions and with ranges only.

    bound.py FRAME.toml

`simulate` is taken from PATH. The pitch is known; x is 0 and the platform level, as in the dissertation's figures.
"""

import json
import sys

from dilution import bounds


def bound(frame, effects):
    where = "--z-range 0.5,4 --step-m 0.25 --x-range=0,0 --tilt-deg 0"
    found = bounds(frame, effects, *where.split())
    figures = {f"{axis}_rms_mm": found[axis][0] for axis in "xyz"}
    return figures | {f"{angle}_rms_deg": found[angle][0] for angle in ("roll", "yaw")}


def main():
    frame = sys.argv[1]
    effects = {"remission": "reference", "ranges": "reference,-remission"}
    print(json.dumps({name: bound(frame, list_) for name, list_ in effects.items()}, indent=1))


main()

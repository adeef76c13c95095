"""What a single scan can tell of the pose at best, by `simulate --dilution` (taken from PATH)."""

import re
import shlex
import subprocess


def bounds(frame, effects, *options):
    """For each component, in mm or deg: (root of the mean variance over the map's area, worst place)."""
    command = ["simulate", "--dilution", "-f", str(frame), "--effects", effects, *options]
    told = subprocess.run(command, capture_output=True, text=True)
    if told.returncode:
        raise SystemExit(f"{shlex.join(command)}\n{told.stderr}")
    found = re.findall(r"(\w+) +rms +([0-9.]+) (?:mm|deg), worst place +([0-9.]+)", told.stderr)
    if len(found) < 6:
        raise SystemExit(f"{shlex.join(command)}\nno scan tells the pose there:\n{told.stderr}")
    return {name: (float(rms), float(worst)) for name, rms, worst in found}

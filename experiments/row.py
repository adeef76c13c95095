"""Writes an experiment's row of the summary.

    row.py OUT TARGET DISSERTATION PUBLISHED OURS BOUND

Figures in braces are looked up: {FILE.json:RUN:x.rms_mm:1} is the statistic x.rms_mm of the run RUN in a report's
JSON, with 1 digit; {FILE.json::a.b:1} of any other JSON. The row goes to OUT/TARGET.row.
"""

import json
import re
import sys
from pathlib import Path


def figure(match):
    path, run, name, digits = match.group(1).split(":")
    value = json.loads(Path(path).read_text())
    if run:
        value = next(case for case in value["runs"] if case["run"] == run)
    for key in name.split("."):
        value = value[key]
    return f"{value:.{digits}f}"


def main():
    out, target, *cells = sys.argv[1:]
    cells = [re.sub(r"\{([^}]*)\}", figure, cell) for cell in cells]
    Path(out, f"{target}.row").write_text(f"| {target} | {' | '.join(cells)} |\n")


main()

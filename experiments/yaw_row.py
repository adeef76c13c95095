"""Writes the row of Fig. 3.13: over which yaw both walls are hit in the middle of the frame and 4 m from it.

    yaw_row.py YAW-RANGE.csv OUT
"""

import csv
import sys
from pathlib import Path


def main():
    with open(sys.argv[1]) as file:
        rows = {float(row["y_m"]): row for row in csv.DictReader(file)}
    inner, outer = rows[0.0], rows[4.0]
    formula = f"{float(inner['formula_deg']):.2f} deg at y = 0, {float(outer['formula_deg']):.2f} deg at y = 4 m"
    scans = f"{float(inner['scans_deg']):.2f} and {float(outer['scans_deg']):.2f} deg"
    cells = ["fig-3-13", f"eq. 3.104: {formula}", "the same", f"{scans} by scans", formula]
    Path(sys.argv[2], "fig-3-13.row").write_text(f"| {' | '.join(cells)} |\n")


main()

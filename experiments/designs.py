"""Compares designs of the ceiling's strips.

    designs.py FRAME.toml OUT

Programs are taken from PATH. A design is an inclination, a width along y, a spacing and a depth; the
strips lie at +-1.5 and +-0.5 spacings with inclinations of alternating sign. Each is put in place of
the frame file's strips on the ceiling. The least standard deviation of x that a scan allows comes from
`simulate --dilution`, as rms and in the worst place of |y| <= 4 m, 0.5 <= z <= 4 m; where it is asked
for, 2000 simulated scans are solved too. Ends with status 4 where scans do better than the bound or
much worse, or a design is not what the table of designs says of it. Leaves the summary's row beside OUT.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

from dilution import bounds

# name, gamma (deg), width, spacing, depth (m), x range (m), check by scans,
# x rms that a prototype had (mm), or none: its exact posterior by ranges, its estimator by remissions
DESIGNS = [
    ("cablar.toml: 30 deg", 30, 0.8, 2.6, 1.5, 0.05, True, 3.78, 1.02),
    ("15 deg", 15, 0.5, 2.8, 1.5, 0.05, False, 8.15, None),
    ("20 deg", 20, 0.6, 2.7, 1.5, 0.05, False, 5.91, None),
    ("30 deg, narrow", 30, 0.4, 2.7, 1.5, 0.05, False, 3.77, None),
    ("40 deg", 40, 0.8, 2.5, 1.5, 0.05, False, 2.59, None),
    ("45 deg", 45, 0.6, 2.4, 1.5, 0.05, True, 2.19, None),
    ("50 deg", 50, 0.5, 2.5, 1.5, 0.05, True, None, None),
    ("50 deg, narrow", 50, 0.4, 2.6, 1.5, 0.05, False, 1.84, None),
    ("60 deg, half depth", 60, 0.5, 2.5, 0.9, 0.05, True, None, None),
]
# Predicted rms over the prototype's, which knew the lines exactly: their noise costs up to 7 %.
# By remissions it was an estimator that corrected the law of ranges but not that of incidence: no bound
# is above it, and simulated scans, whose estimator corrects both, are solved to 0.86 of it.
OVER_PROTOTYPE = {"reference,-remission": [0.98, 1.10], "reference": [0.80, 1.0]}
# Scans over the bound. 2000 of them tell an rms to 2 %, and so do the map's places that over its area.
SCANS_OVER_BOUND = [0.94, 1.15]


def frame_text(base, design):
    """The frame file with the design's strips on the ceiling."""
    _, gamma, width, spacing, depth = design[:5]
    # Tables before the first strip and from the scanner on are kept.
    head = base[: base.index("[[strip]]")]
    tail = base[base.index("[scanner]") :]
    strips = ""
    for k, place in enumerate([1.5, 0.5, -0.5, -1.5]):
        sign = 1 if k % 2 == 0 else -1
        strips += (
            f'[[strip]]\nface = "upper"\noffset_m = {place * spacing:.6f}\nwidth_m = {width}\n'
            f"inclination_deg = {sign * gamma}.0\nx_m = [{-depth / 2}, {depth / 2}]\n\n"
        )
    return head + strips + tail


def output(command):
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{command}\n{done.stderr}")
    return done.stdout


def predicted(frame, design, effects):
    """rms and worst place of x, mm."""
    x = design[5]
    where = f"--y-range=-4,4 --z-range 0.5,4 --step-m 0.5 --x-range=-{x},{x} --tilt-deg 1 --dilution-poses 40"
    return bounds(frame, effects, *where.split())["x"]


def reached(frame, design, effects, out):
    """rms and largest error of x in simulated scans, mm."""
    x = design[5]
    run = out / "run"
    output(
        f"simulate -q -f {frame} --effects {effects} --trajectory random --n-scans 2000 --seed 11"
        f" --z-range 0.5,4 --x-range=-{x},{x} --truth {run}.truth.csv --imu {run}.imu.csv"
        f" -o {run}.scans.csv && extract-lines -q -f {frame} {run}.scans.csv | solve-pose -q -f {frame} --imu {run}.imu.csv"
        f" --imu-pitch-sigma-deg 0 > {run}.poses.csv"
    )
    text = output(f"report -q --truth {run}.truth.csv --json {run}.poses.csv")
    x = json.loads(text)["runs"][0]["x"]
    return x["rms_mm"], x["max_mm"]


def main():
    base, out = Path(sys.argv[1]).read_text(), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    missed, reach = [], {}
    print(f"{'x in mm':<22}{'W':>5}{'spacing':>8} |{'ranges: rms':>12}{'worst':>7}{'scans':>7}{'max':>6}"
          f" |{'remission: rms':>15}{'worst':>7}{'scans':>7}{'max':>6}")
    for design in DESIGNS:
        name, gamma, width, spacing = design[:4]
        frame = out / (re.sub(r"[^0-9a-z]+", "-", name) + ".toml")
        frame.write_text(frame_text(base, design))
        line = f"{name:<22}{width:>5}{spacing:>8} |"
        for effects, known in [("reference,-remission", design[7]), ("reference", design[8])]:
            rms, worst = predicted(frame, design, effects)
            line += f"{rms:>{12 if '-' in effects else 15}.2f}{worst:>7.2f}"
            low, high = OVER_PROTOTYPE[effects]
            if known and not low <= rms / known <= high:
                missed.append(f"{name}, {effects}: {rms:.2f} mm predicted, {known} by the prototype")
            if design[6]:
                scans_rms, scans_max = reached(frame, design, effects, out)
                line += f"{scans_rms:>7.2f}{scans_max:>6.1f}"
                reach[name, effects] = f"x {scans_rms:.2f} mm rms, max {scans_max:.1f} mm", rms
                low, high = SCANS_OVER_BOUND
                if not low * rms <= scans_rms <= high * rms:
                    missed.append(f"{name}, {effects}: scans reach {scans_rms:.2f}, bound {rms:.2f} mm")
            else:
                line += f"{'':>13}"
            line += " |" if "-" in effects else ""
        print(line, flush=True)
    best = min((key for key in reach if "-" not in key[1]), key=lambda key: reach[key][1])
    published = DESIGNS[0][0]
    cells = [
        "strip-designs",
        f"{DESIGNS[0][1]} deg strips",
        f"ranges, {published}: {reach[published, 'reference,-remission'][0]}",
        f"{best[0]}: {reach[best][0]}",
        f"{best[0]}: {reach[best][1]:.2f} mm rms",
    ]
    (out.parent / "strip-designs.row").write_text(f"| {' | '.join(cells)} |\n")
    for what in missed:
        print(f"MISSED: {what}")
    sys.exit(4 if missed else 0)


main()

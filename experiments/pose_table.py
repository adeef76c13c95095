"""Prints what the pose estimate reaches, case by case, beside its goals and bounds.

    pose_table.py TABLE.toml OUT [--only TEXT] [--markdown FILE]

Programs are taken from PATH. Each row simulates scans, solves them and lets `report` compare them with
the truth; runs of several seeds are pooled. Ends with status 4 where a goal is missed.
"""

import argparse
import json
import math
import re
import shlex
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from pathlib import Path

from dilution import bounds

UNITS = {"x": "mm", "y": "mm", "z": "mm", "roll": "deg", "pitch": "deg", "yaw": "deg"}
# Where no row says otherwise, a component's mean squared error over its predicted variance.
NEES = [0.8, 1.3]
# Errors beyond these are no estimate of the same pose (spread of the workspace's edges), mm.
GROSS_MM = {"x": 500, "y": 100, "z": 100}
IMU = "[imu]\nattitude_bias_deg = 0\nattitude_noise_deg = 0.5\nattitude_walk_deg_sqrt_s = 0\nmisalignment_deg = 0\n"


def shell(command, stdout=None):
    """Runs a pipeline; a failing stage ends the row."""
    subprocess.run(["bash", "-euo", "pipefail", "-c", command], check=True, stdout=stdout)


def run(row, seed, out):
    """One seed of a row: the statistics that `report --json` gives."""
    out.mkdir(parents=True, exist_ok=True)
    q = shlex.quote
    frame = q(row["frame"])
    sizes = row.get("sizes", "")
    if isinstance(sizes, list):
        sizes = sizes[row["seeds"].index(seed)]
    sizes += (IMU if row["pitch"] == "imu" else "")
    (out / "effects.toml").write_text(sizes)
    course = row.get("trajectory", "")
    if "--trajectory" not in course:
        course += f" --trajectory random --z-range {row['zone']}"
    if row["scans"]:
        course += f" --n-scans {row['scans']}"
    at = q(str(out))
    if "prepare" in row:
        shell(row["prepare"].format(seed=seed, out=at))
    course = course.replace("{out}", at)
    pitch = {
        "known": f"--imu {q(str(out))}/imu.csv --imu-pitch-sigma-deg 0",
        "imu": f"--imu {q(str(out))}/imu.csv --imu-pitch-sigma-deg 0.5",
        "none": "",
    }[row["pitch"]]
    shell(
        f"simulate -q -f {frame} --effects {row['effects']} --effects-file {at}/effects.toml"
        f" {course} --seed {seed} --truth {at}/truth.csv --imu {at}/imu.csv -o {at}/scans.csv"
    )
    shell(
        f"extract-lines -q -f {frame} {row.get('lines', '')} {at}/scans.csv"
        f" | solve-pose -q -f {frame} {pitch} {row.get('pose', '')} > {at}/poses.csv || test $? = 3"
    )
    shell(f"report -q --truth {at}/truth.csv --json {at}/poses.csv > {at}/report.json")
    (out / "scans.csv").unlink()
    return json.loads((out / "report.json").read_text())["runs"][0]


def bound(row):
    """Least rms of each component that one scan allows, from the information in it."""
    if not row.get("bound", True):
        return {}
    edges = "reference,-remission" if "-remission" in row["effects"] else "reference"
    mode = re.findall(r"--(?:frequency-hz|resolution-deg) \S+", row.get("trajectory", ""))
    sigma_deg = {"known": 0, "imu": 0.5, "none": 3}[row["pitch"]]
    where = f"--z-range {row['zone']} --step-m 0.5 --dilution-poses 16 --dilution-pitch-sigma-deg {sigma_deg}"
    found = bounds(row["frame"], edges, *shlex.split(f"{where} {' '.join(mode)}"))
    return {f"{name}_rms_{UNITS[name]}": rms for name, (rms, _) in found.items() if rms > 0}


def pool(row, runs):
    """Figures of several runs as if they were one."""
    figures = {}
    rows = sum(r["scans"]["rows"] for r in runs)
    figures["solved_pct"] = 100.0 * sum(r["scans"]["solved"] for r in runs) / rows
    figures["scans"] = rows
    for name, unit in UNITS.items():
        parts = [r[name] for r in runs if r[name].get("n")]
        n = sum(p["n"] for p in parts)
        if not n:
            continue
        figures[f"{name}_n"] = n
        squares = sum(p["n"] * p[f"rms_{unit}"] ** 2 for p in parts)
        figures[f"{name}_rms_{unit}"] = math.sqrt(squares / n)
        figures[f"{name}_max_{unit}"] = max(p[f"max_{unit}"] for p in parts)
        if all(p.get("nees") is not None for p in parts):
            figures[f"{name}_nees"] = sum(p["n"] * p["nees"] for p in parts) / n
    return figures


def misses(row, figures, all_figures):
    """What of a row's goals is missed, in words."""
    found = []
    for key, most in row["goal"].items():
        value = figures.get(key, math.inf)
        if not value <= most * (1 + 1e-9):
            found.append(f"{key} {value:.4g} > {most:g}")
    for name in row["components"]:
        low, high = row.get("nees_of", {}).get(name, row.get("nees", NEES))
        value = figures.get(f"{name}_nees")
        if value is None or not low <= value <= high:
            shown = "none" if value is None else f"{value:.2f}"
            found.append(f"{name} NEES {shown} outside {low:g} to {high:g}")
    if figures["solved_pct"] < 100:
        found.append(f"solved {figures['solved_pct']:.2f} %")
    if row.get("gross"):
        for name, most in GROSS_MM.items():
            if not figures.get(f"{name}_max_mm", math.inf) <= most:
                found.append(f"gross error in {name}")
    other = row.get("not_worse_than")
    if other and other in all_figures:
        for key in ("x_rms_mm", "y_rms_mm", "z_rms_mm", "yaw_rms_deg"):
            # The same scans, so a hundredth is the estimators', not the draw's.
            if figures[key] > 1.01 * all_figures[other][key]:
                found.append(f"{key} {figures[key]:.4g} > {all_figures[other][key]:.4g} of '{other}'")
    return found


def cell(row, figures, key):
    value = figures.get(key)
    if value is None:
        return "-"
    text = f"{value:.3g}" if value < 100 else f"{value:.0f}"
    least = figures["bound"].get(key)
    return f"{text} ({value / least:.2f} x)" if least else text


COLUMNS = [
    ("x rms mm", "x_rms_mm"),
    ("x max mm", "x_max_mm"),
    ("y rms mm", "y_rms_mm"),
    ("z rms mm", "z_rms_mm"),
    ("roll rms deg", "roll_rms_deg"),
    ("pitch rms deg", "pitch_rms_deg"),
    ("yaw rms deg", "yaw_rms_deg"),
]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("table", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="", help="rows whose name contains this")
    parser.add_argument("--markdown", type=Path, help="write the table there as well")
    parser.add_argument("-j", type=int, default=cpu_count(), help="runs at the same time")
    args = parser.parse_args()
    spec = tomllib.loads(args.table.read_text())
    rows = [{**spec["defaults"], **row} for row in spec["row"]]
    wanted = [row for row in rows if args.only in row["name"]]
    needed = {row.get("not_worse_than") for row in wanted}
    wanted = [row for row in rows if row in wanted or row["name"] in needed]

    results = {}
    with ThreadPoolExecutor(args.j) as executor:
        tasks = {}
        bounds = {row["name"]: executor.submit(bound, row) for row in wanted}
        for number, row in enumerate(rows):
            if row in wanted:
                for seed in row["seeds"]:
                    out = args.out / f"{number:02}-{seed}"
                    tasks.setdefault(row["name"], []).append(executor.submit(run, row, seed, out))
        for row in wanted:
            runs = [task.result() for task in tasks[row["name"]]]
            results[row["name"]] = pool(row, runs) | {"bound": bounds[row["name"]].result()}

    header = ["case", "scans", *(title for title, _ in COLUMNS), "NEES", "goal"]
    lines, missed = [], []
    for row in wanted:
        figures = results[row["name"]]
        nees = [figures.get(f"{name}_nees") for name in row["components"]]
        nees = [value for value in nees if value is not None]
        span = f"{min(nees):.2f} to {max(nees):.2f}" if nees else "-"
        found = misses(row, figures, results)
        missed += [f"{row['name']}: {'; '.join(found)}"] if found else []
        cells = [
            cell(row, figures, key) if key.split("_")[0] in row["components"] else "-"
            for _, key in COLUMNS
        ]
        lines.append([row["name"], str(figures["scans"]), *cells, span, "missed" if found else "met"])
    widths = [max(len(line[k]) for line in [header, *lines]) for k in range(len(header))]
    for line in [header, *lines]:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths)).rstrip())
    print("\n(1.05 x): that many times what `simulate --dilution` says one scan allows; the ranges of mixed"
          "\npixels, which it does not count, tell more. NEES: least and largest of the components.")
    if args.markdown:
        text = [header, ["---"] * len(header), *lines]
        args.markdown.write_text("".join("| " + " | ".join(line) + " |\n" for line in text))
    for text in missed:
        print(f"missed: {text}", file=sys.stderr)
    return 4 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

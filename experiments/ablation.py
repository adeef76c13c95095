"""What each effect of the scanner does to the edges of a strip and to the pose, one effect at a time.

    ablation.py FRAME.toml OUT ROWS SCANS

Programs are taken from PATH. The platform stands level 5 m below the ceiling (z = 0.5 m), anywhere along y and x, at
25 Hz and 1/6 deg; a strip is 40 times as bright as what is behind it. Edges nearer than 6 m count. Their errors are
across the beam, mm, mean +- standard deviation, positive into the strip: "hits" is the first or last beam with the
strip's range, "interval" the middle between it and the next, which is what ranges tell of an edge, "remission" the
place found between the beams, none where remissions are not fit for it (pencil beams, saturation, 4 bit) and only
the interval is used. The published columns are a Monte Carlo of one strip of 50 mm, 5 m away, whose beams
are told by remission alone, so that its hits begin before half the spot is on the strip.

Writes OUT/table.md and OUT/table.csv, and the row of the summary to ROWS/ablation.row.
"""

import csv
import json
import math
import statistics
import subprocess
import sys
import tomllib
from pathlib import Path

MODE = "--frequency-hz 25 --resolution-deg 0.1667"
DEVICE = {"noise": 0.0, "contrast": 0.025, "digits": 65000.0}
SR = "lms511-sr"
NOISE, AT_20, AT_5 = {"noise": 0.05}, {"ceiling": 13000.0}, {"ceiling": 3250.0}
# Name, effects beside remissions, sizes of remission, options (or a scanner's model, which goes into the frame file),
# published left edge by hits and by half height.
MODELS = [
    ("pencil beam", "", {}, "", "+7.3 ± 4.2", "0 ± 4.2"),
    ("+ footprint", "footprint", {}, "", "-3.2 ± 4.2", "-0.2 ± 0.5"),
    ("+ 5 % remission noise", "footprint", NOISE, "", "-2.9 ± 4.2", "0 ± 1.0"),
    ("+ saturation at 20 % of the peak", "footprint", AT_20, "", "-10.2 ± 4.2", "-12.7 ± 1.8"),
    ("+ saturation at 5 %", "footprint", AT_5, "", "-10.2 ± 4.1", "-19.4 ± 2.3"),
    ("8 bit, not saturated", "footprint", {"digits": 254.0}, "", "-3 ± 4.2", "-0.2 ± 0.5"),
    ("4 bit, not saturated", "footprint", {"digits": 15.0}, "", "-2 ± 4.2", "0 ± 0.5"),
    ("scans turned by an unsteady motor", "footprint,angle-jitter", {}, "", "-3.0 ± 4.4", "-0.2 ± 1.4"),
    ("5 % of the beams lost", "footprint,dropouts", {}, "--dropout-share 0.05", "-2.2 ± 5.5", "+0.7 ± 3.7"),
    ("ranges: noise, bias, 1 mm", "footprint,noise,bias,quantisation", {}, "", "", ""),
    ("mixed pixels", "footprint,mixed", {}, "", "", ""),
    ("SR optics", "footprint", {}, SR, "-13.8 ± 4.2", "-3.4 ± 0.4"),
    (
        "noise, saturation at 20 %, 8 bit, turned",
        "footprint,angle-jitter",
        {"noise": 0.05, "digits": 1270.0, "ceiling": 254.0},
        "",
        "-10.3 ± 4.4",
        "-12.8 ± 2.3",
    ),
    ("all of the reference set-up and mixed", "reference,mixed", {"noise": 0.04}, "", "", ""),
]
NEAR_M = 6.0


def run(command):
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{command}\n{done.stderr}")
    return done.stdout


def edge_errors(frame, lines, truth):
    """Errors into the strip, mm, by hits, by the interval's middle and by remission."""
    dz = frame["box"]["dz_m"]
    strips = [strip for strip in frame["strip"] if strip["face"] == "upper"]
    errors = {"hits": [], "interval": [], "remission": []}
    with open(truth) as file:
        poses = {row["stamp_ns"]: row for row in csv.DictReader(file)}
    with open(lines) as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        x, y, z = (float(poses[row["stamp_ns"]][axis]) for axis in ("x_m", "y_m", "z_m"))
        lists = [row[f"edge_{name}"].split() for name in ("strip", "kind", "from_rad", "to_rad", "rad")]
        if not lists[4]:
            lists[4] = ["nan"] * len(lists[0])
        for index, kind, low, high, at in zip(*lists):
            if int(index) < 0:
                continue
            strip = strips[int(index)]
            side = 1 if kind == "on" else -1
            edge_y = strip["offset_m"] + side * strip["width_m"] / 2
            edge_y += x * math.tan(math.radians(strip["inclination_deg"]))
            across_mm = 1e3 * side * math.hypot(dz - z, edge_y - y)
            if abs(across_mm) > 1e3 * NEAR_M:
                continue
            true = math.atan2(dz - z, edge_y - y)
            low, high, at = float(low), float(high), float(at)
            errors["hits"].append(across_mm * ((high if kind == "on" else low) - true))
            errors["interval"].append(across_mm * ((low + high) / 2 - true))
            if math.isfinite(at):
                errors["remission"].append(across_mm * (at - true))
    return errors


def summed(values):
    if len(values) < 2:
        return "–"
    return f"{statistics.fmean(values):+.1f} ± {statistics.stdev(values):.1f}"


def main():
    frame_path, out, rows_dir, scans = sys.argv[1:]
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    frame = tomllib.loads(Path(frame_path).read_text())
    table = []
    for number, (name, effects, sizes, options, *published) in enumerate(MODELS):
        truth, lines, sizes_file = (out / f"{number}.{kind}" for kind in ("truth.csv", "lines.csv", "toml"))
        remission = DEVICE | sizes if "reference" not in effects else sizes
        text = "".join(f"{key} = {value}\n" for key, value in remission.items())
        sizes_file.write_text(f"[remission]\n{text}")
        effects = ",".join(filter(None, [effects, "remission"]))
        frame_file = frame_path
        if options == SR:
            frame_file, options = out / f"{number}.frame.toml", ""
            text = Path(frame_path).read_text().replace(frame["scanner"]["model"], SR)
            frame_file.write_text(text)
        poses = run(
            f"simulate -q --jobs 1 -f {frame_file} --trajectory random --tilt-deg 0 --z-range 0.5,0.5 {MODE}"
            f" --n-scans {scans} --effects {effects} --effects-file {sizes_file} {options} --truth {truth}"
            f" | extract-lines -q -f {frame_file} --deskew none | tee {lines}"
            f" | solve-pose -q -f {frame_file} --pitch-deg 0 | tee {out}/{number}.poses.csv"
            f" | report -q --json --truth {truth} -"
        )
        pose = json.loads(poses)["runs"][0]
        errors = edge_errors(frame, lines, truth)
        lines.unlink()
        table.append(
            [name]
            + [summed(errors[way]) for way in ("hits", "interval", "remission")]
            + published
            + [f"{pose['x']['rms_mm']:.2f}", f"{pose['yaw']['rms_deg']:.3f}", f"{pose['scans']['solved_pct']:.1f}"]
        )
    header = ["model", "hits", "interval", "remission", "published: hits", "published: half height"]
    header += ["x rms, mm", "yaw rms, deg", "solved, %"]
    with open(out / "table.csv", "w") as file:
        csv.writer(file, lineterminator="\n").writerows([header] + table)
    lines = [header, ["---"] * len(header)] + table
    (out / "table.md").write_text("".join(f"| {' | '.join(line)} |\n" for line in lines))
    by_name = {row[0]: row for row in table}
    pencil, footprint = by_name["pencil beam"], by_name["+ footprint"]
    saturated, everything = by_name["+ saturation at 20 % of the peak"], table[-1]
    row = [
        "ablation",
        "not looked at",
        f"edge by hits: pencil beam {pencil[1]} mm, with footprint {footprint[1]} mm",
        f"edge by remission: {footprint[3]} mm; saturated, by the interval: {saturated[2]} mm;"
        f" x {everything[6]} mm rms with all",
        "one strip of 50 mm: half height -0.2 ± 0.5, saturated -12.7 ± 1.8 mm",
    ]
    Path(rows_dir, "ablation.row").write_text(f"| {' | '.join(row)} |\n")


main()

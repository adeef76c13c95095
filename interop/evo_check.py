#!/usr/bin/env python3
"""Compares absolute and relative pose errors of `report` with those of evo, from the same two files.

    evo_check.py OUT      writes OUT/evo-ref.tum and OUT/evo-est.tum, runs report from the PATH

evo has no relative errors over time: at a steady rate those over 1 s are those over so many poses.
Pairs by distance are taken by the reference's way in both.
"""

import copy
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from evo.core import metrics, sync
from evo.core.units import Unit
from evo.tools import file_interface

RATE = 50
COUNT = 4000
FIGURES = ["rms", "mean", "median", "std", "min", "max", "sse"]
TOLERANCE = {"mm": 1e-3, "deg": 1e-6}


def quaternion(roll, pitch, yaw):
    sr, sp, sy = (np.sin(angle / 2) for angle in (roll, pitch, yaw))
    cr, cp, cy = (np.cos(angle / 2) for angle in (roll, pitch, yaw))
    return np.array([
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ])


def write(path, poses):
    with open(path, "w") as file:
        for i, pose in enumerate(poses.T):
            numbers = [*pose[:3], *quaternion(*pose[3:])]
            stamp = f"{1_700_000_000 + i // RATE}.{i % RATE * (10**9 // RATE):09d}"
            print(stamp, *(f"{v:.12f}" for v in numbers), file=file)


def make(out):
    """A loop, and what was measured of it: late, noisy, turned by 2 degrees and moved."""
    random = np.random.default_rng(5)

    def loop(t):
        return np.array([
            0.3 * np.sin(0.2 * t),
            3.2 * np.sin(0.45 * t),
            2.2 + 1.2 * np.cos(0.63 * t),
            0.05 * np.sin(0.7 * t),
            0.03 * np.cos(0.4 * t),
            0.1 * np.sin(0.3 * t),
        ])

    t = np.arange(COUNT) / RATE
    measured = loop(t - 0.037)
    turn = np.radians(2)
    x, y = measured[0].copy(), measured[1].copy()
    measured[0] = np.cos(turn) * x - np.sin(turn) * y + 0.05
    measured[1] = np.sin(turn) * x + np.cos(turn) * y - 0.02
    measured[5] += turn
    sigma = np.array([0.003, 0.002, 0.002] + [np.radians(0.05)] * 3)
    measured += sigma[:, None] * random.standard_normal(measured.shape)
    paths = out / "evo-ref.tum", out / "evo-est.tum"
    write(paths[0], loop(t))
    write(paths[1], measured)
    return paths


def ours(paths, align, pairs):
    command = ["report", "--truth", str(paths[0]), str(paths[1]), "--json", "--align", align,
               "--rpe-pairs", pairs]
    for delta in ("1f", "50f", "1s", "1m"):
        command += ["--rpe", delta]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["runs"][0]


def compare(what, block, unit, theirs, factor):
    """The figures that both have; evo's mean is the bias of an error that has no sign."""
    worst = 0.0
    for name in FIGURES:
        key = {"mean": "bias", "rms": "rms"}.get(name, name)
        key = f"sse_{unit}2" if name == "sse" else f"{key}_{unit}"
        their = theirs.get_statistic(getattr(metrics.StatisticsType, {"rms": "rmse"}.get(name, name)))
        their *= factor**2 if name == "sse" else factor
        mine = block[key]
        if name == "std":
            # evo divides by n, report by n - 1.
            mine *= np.sqrt((block["n"] - 1) / block["n"])
        # Sums of squares grow with the number of poses.
        limit = TOLERANCE[unit] * (1 + (abs(their) if name == "sse" else 0))
        off = abs(mine - their)
        assert off <= limit, f"{what} {name}: {mine}, evo {their}"
        if name != "sse":
            worst = max(worst, off)
    assert block["n"] == len(theirs.error), f"{what}: {block['n']} errors, evo {len(theirs.error)}"
    return worst


def main(out):
    paths = make(out)
    reference = file_interface.read_tum_trajectory_file(str(paths[0]))
    estimate = file_interface.read_tum_trajectory_file(str(paths[1]))
    reference, estimate = sync.associate_trajectories(reference, estimate)
    worst = {"mm": 0.0, "deg": 0.0}
    count = 0
    relations = [
        ("position", "mm", metrics.PoseRelation.translation_part, 1e3),
        ("rotation", "deg", metrics.PoseRelation.rotation_angle_deg, 1.0),
    ]
    for align in ("none", "se3"):
        aligned = copy.deepcopy(estimate)
        if align == "se3":
            aligned.align(reference)
        for pairs in ("consecutive", "all"):
            found = ours(paths, align, pairs)
            for name, unit, relation, factor in relations:
                theirs = metrics.APE(relation)
                theirs.process_data((reference, aligned))
                off = compare(f"APE {align} {name}", found[name], unit, theirs, factor)
                worst[unit] = max(worst[unit], off)
                for delta, number, kind in (("1f", 1, Unit.frames), ("50f", 50, Unit.frames),
                                            ("1s", RATE, Unit.frames), ("1m", 1.0, Unit.meters)):
                    theirs = metrics.RPE(relation, number, kind, all_pairs=pairs == "all",
                                         pairs_from_reference=kind == Unit.meters)
                    theirs.process_data((reference, aligned))
                    block = found["rpe"][delta][name]
                    what = f"RPE {delta} {align} {pairs} {name}"
                    worst[unit] = max(worst[unit], compare(what, block, unit, theirs, factor))
                    count += 1
    print(f"APE and RPE ({count} blocks of {len(FIGURES)} figures, {len(estimate.timestamps)} poses) as evo has "
          f"them, within {worst['mm'] * 1e-3:.1e} m and {worst['deg']:.1e} deg")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

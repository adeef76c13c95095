#!/usr/bin/env python3
"""Compares the Allan deviations of `report --imu --json` with those of allantools, from the same record.

    allan_check.py imu.csv report.json
"""

import csv
import json
import sys

import allantools
import numpy as np

COLUMNS = {
    "gyro_x": ("gyro_x_rad_s", 180 / np.pi),
    "gyro_y": ("gyro_y_rad_s", 180 / np.pi),
    "gyro_z": ("gyro_z_rad_s", 180 / np.pi),
    "accel_x": ("accel_x_m_s2", 1.0),
    "accel_y": ("accel_y_m_s2", 1.0),
    "accel_z": ("accel_z_m_s2", 1.0),
}


def main(record, report):
    with open(record, newline="") as file:
        rows = list(csv.DictReader(file))
    with open(report) as file:
        found = json.load(file)["imu"]
    stamps = np.array([int(row["stamp_ns"]) for row in rows])
    period = (stamps[-1] - stamps[0]) / 1e9 / (len(stamps) - 1)
    assert found["samples"] == len(rows), (found["samples"], len(rows))
    assert abs(found["period_s"] / period - 1) < 1e-9, (found["period_s"], period)
    points = 0
    worst = 0.0
    for name, (column, factor) in COLUMNS.items():
        data = np.array([float(row[column]) for row in rows]) * factor
        channel = found["channels"][name]
        assert abs(channel["mean"] - data.mean()) < 1e-6, name
        assert abs(channel["std"] - data.std(ddof=1)) < 1e-6, name
        ours = np.array(channel["allan_deviation"])
        taus = np.array(channel["tau_s"])
        assert len(taus) > 20, name
        _, theirs, _, _ = allantools.oadev(data, rate=1 / period, data_type="freq", taus=taus)
        assert len(theirs) == len(ours), (name, len(theirs), len(ours))
        off = np.max(np.abs(ours / theirs - 1))
        assert off < 1e-6, f"{name}: off by {off} of itself"
        worst = max(worst, off)
        points += len(ours)
    print(f"{points} Allan deviations of {len(COLUMNS)} channels as allantools has them, within {worst:.1e}")


if __name__ == "__main__":
    main(*sys.argv[1:])

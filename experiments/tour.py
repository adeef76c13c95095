"""Prints a trajectory that goes from place to place and stands at each.

    tour.py PLACES.csv [SPEED_M_S [SECONDS]]

PLACES.csv has the columns x_m, y_m, z_m, roll_deg, pitch_deg, yaw_deg, a row a place, in the order in which
they are gone to. A quintic (Kurniawan 2017, section 5.2: point to point, smooth) of at most SPEED_M_S leads
from one to the next, SECONDS are stood at each.
"""

import csv
import math
import sys

STEP_NS = 5_000_000
START_NS = 1_767_225_600_000_000_000
COLUMNS = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")


def main():
    with open(sys.argv[1]) as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        places = [[float(row[c]) for c in COLUMNS] for row in rows]
    places = [p[:3] + [math.radians(a) for a in p[3:]] for p in places]
    speed = float(sys.argv[2]) if len(sys.argv) > 2 else 0.5
    stand = round(float(sys.argv[3]) / (STEP_NS * 1e-9)) if len(sys.argv) > 3 else 400
    points = [(places[0], [0.0] * 3)] * stand
    for a, b in zip(places, places[1:]):
        distance = math.dist(a[:3], b[:3])
        # A turn in one place takes a second.
        seconds = max(15 / 8 * distance / speed, 1.0)
        steps = math.ceil(seconds / (STEP_NS * 1e-9))
        for k in range(1, steps + 1):
            u = k / steps
            share = u**3 * (10 - 15 * u + 6 * u**2)
            slope = 30 * u**2 * (1 - u) ** 2 / (steps * STEP_NS * 1e-9)
            pose = [p + share * (q - p) for p, q in zip(a, b)]
            points.append((pose, [slope * (q - p) for p, q in zip(a[:3], b[:3])]))
        points.extend([(b, [0.0] * 3)] * stand)
    print("stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,vx_m_s,vy_m_s,vz_m_s")
    for i, (pose, velocity) in enumerate(points):
        print(START_NS + i * STEP_NS, *(repr(v) for v in pose + velocity), sep=",")


main()

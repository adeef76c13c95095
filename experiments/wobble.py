"""Prints a trajectory: along the frame's diagonal at constant speed, while x sways and yaw turns.

    wobble.py SPEED_M_S SEED [SECONDS]

x sways by 5 mm at 0.25 Hz, yaw by 0.3 deg at 0.15 Hz; where they begin, where the rest of the pose is and,
if SECONDS are fewer than the diagonal takes, where on it the run begins depends on SEED.
"""

import math
import random
import sys

SWAY_M, SWAY_HZ = 0.005, 0.25
TURN_RAD, TURN_HZ = math.radians(0.3), 0.15
STEP_NS = 4_000_000
START_NS = 1_767_225_600_000_000_000
FROM, TO = (-4.0, 0.465), (4.0, 3.5)

speed = float(sys.argv[1])
draw = random.Random(int(sys.argv[2])).uniform
length = math.dist(FROM, TO)
seconds = float(sys.argv[3]) if len(sys.argv) > 3 else length / speed
along = [(b - a) / length for a, b in zip(FROM, TO)]
begin = draw(0, length - speed * seconds)
x0, yaw0 = draw(-0.03, 0.03), math.radians(draw(-0.5, 0.5))
roll, pitch = math.radians(draw(-0.5, 0.5)), math.radians(draw(-0.5, 0.5))
sway0, turn0 = draw(0, 2 * math.pi), draw(0, 2 * math.pi)

print("stamp_ns,x_m,y_m,z_m,roll_rad,pitch_rad,yaw_rad,vx_m_s,vy_m_s,vz_m_s")
for i in range(int(seconds * 1e9 / STEP_NS) + 1):
    t = i * STEP_NS * 1e-9
    sway, turn = (2 * math.pi * hz * t + at for hz, at in ((SWAY_HZ, sway0), (TURN_HZ, turn0)))
    y, z = (a + (begin + speed * t) * d for a, d in zip(FROM, along))
    row = [
        x0 + SWAY_M * math.sin(sway), y, z, roll, pitch, yaw0 + TURN_RAD * math.sin(turn),
        2 * math.pi * SWAY_HZ * SWAY_M * math.cos(sway), speed * along[0], speed * along[1],
    ]
    print(START_NS + i * STEP_NS, *map(repr, row), sep=",")

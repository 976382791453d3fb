"""Makes `poses.csv` and `turning.csv`: a payload on an arm of three joints that turns at 5 rad/s, by Pinocchio 4.1.0.

The sensor is the last, locked joint: `rnea` gives the wrench that holds the payload there, and the sensor reads the
opposite. The accelerometer is at the sensor's origin, the gyroscope in its axes. Noise: 1 mN and 0.02 mN·m.
"""

import csv

import numpy as np
import pinocchio as pin

RATE_HZ = 100
ROWS = 150
MASS_KG = 0.5
CENTRE_M = np.array([0.02, -0.03, 0.06])

model = pin.Model()
joint = 0
for kind, place in (
    (pin.JointModelRZ(), [0, 0, 0.2]),
    (pin.JointModelRY(), [0, 0, 0.3]),
    (pin.JointModelRX(), [0.25, 0, 0]),
    (pin.JointModelRZ(), [0.15, 0, 0.05]),
):
    placement = pin.SE3(np.eye(3), np.array(place, dtype=float))
    joint = model.addJoint(joint, kind, placement, f"joint{model.njoints}")
model.appendBodyToJoint(joint, pin.Inertia.FromSphere(MASS_KG, 0.02), pin.SE3(np.eye(3), CENTRE_M))
sensor = model.addFrame(pin.Frame("sensor", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
data = model.createData()
random = np.random.default_rng(4)


def row(q, v, a):
    """The wrench, the reading of an accelerometer, angular velocity and orientation of the sensor."""
    pin.rnea(model, data, q, v, a)
    wrench = -data.f[joint].vector
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    rotation = data.oMf[sensor].rotation
    acceleration = pin.getFrameClassicalAcceleration(model, data, sensor, pin.LOCAL).linear
    felt = acceleration - rotation.T @ model.gravity.linear
    turn = pin.getFrameVelocity(model, data, sensor, pin.LOCAL).angular
    noise = random.normal(size=6) * ([1e-3] * 3 + [2e-5] * 3)
    return [*(wrench + noise), *felt, *turn, *pin.Quaternion(rotation).coeffs()]


def write(name, rows):
    with open(name, "w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(
            "t_s fx_n fy_n fz_n mx_nm my_nm mz_nm ax ay az gyro_x gyro_y gyro_z qx qy qz qw".split()
        )
        out.writerows([f"{value:.7g}" for value in values] for values in rows)


still = np.zeros(4)
write("poses.csv", [[k, *row(random.uniform(-2, 2, 4), still, still)] for k in range(24)])

times = np.arange(ROWS) / RATE_HZ
size, pace, phase = np.array([0.7, 0.6]), np.array([3.1, 2.3]), np.array([0.0, 1.0])
turning = []
for t in times:
    angle = pace * t + phase
    q = np.array([5 * t, *(size * np.sin(angle)), 0.3])
    v = np.array([5, *(size * pace * np.cos(angle)), 0])
    a = np.array([0, *(-size * pace**2 * np.sin(angle)), 0])
    turning.append([t, *row(q, v, a)])
write("turning.csv", turning)

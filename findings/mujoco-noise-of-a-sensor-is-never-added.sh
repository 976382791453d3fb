#!/usr/bin/env bash
# Question: how noisy are the readings of a simulated force sensor with noise="0.5"?
# Good guess: a standard deviation of 0.5 N, if not by default then when the model's flags ask for it.
# True: none. The attribute is compiled into the model (sensor_noise) and used by nothing: two runs have the same bits,
# the readings of a tool at rest do not scatter at all, and there is no flag any more that would add noise. A
# calibration that was tried on such readings was tried on exact ones.
# Package: MuJoCo 4.0.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import mujoco
import numpy as np

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body>
      <geom size=".1" mass="2"/>
      <site name="flange"/>
    </body>
  </worldbody>
  <sensor><force site="flange" noise="0.5"/></sensor>
</mujoco>""")


def run():
    data = mujoco.MjData(model)
    readings = []
    for _ in range(500):
        mujoco.mj_step(model, data)
        readings.append(data.sensordata.copy())
    return np.array(readings)


readings = run()
print("noise in the model:", model.sensor_noise, "N")
print("mean of 500 readings:", readings.mean(axis=0), "N; standard deviation:", readings.std(axis=0), "N")
print("flags of MuJoCo that name noise:", [flag for flag in dir(mujoco.mjtEnableBit) if "NOISE" in flag.upper()])
assert model.sensor_noise[0] == 0.5
assert abs(readings[:, 2].mean() - 19.62) < 1e-9
assert (readings.std(axis=0) < 1e-9).all() and (run() == readings).all()
assert not [flag for flag in dir(mujoco.mjtEnableBit) if "NOISE" in flag.upper()]
PYTHON

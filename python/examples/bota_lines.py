"""A Bota Systems sensor as a reference: `shellcal record PORT --reference "lines:python bota_lines.py CONFIG.json"`.

Prints a line of JSON for each sample of `bota-driver` (PyPI). CONFIG.json is the driver's own; `dummy` is the sensor that it makes up.
"""

import json
import sys

import bota_driver


def configuration(name):
    if name != "dummy":
        return name
    made_up = bota_driver.BotaDriverConfig()
    made_up.communication_interface_name, made_up.product_name, made_up.serial_number = "Bota_Dummy", "dummy", "0"
    made_up.dummy_communication_interface_params = bota_driver.BotaDummyCommunicationInterfaceConfig()
    made_up.genA_sensor_operation_params = bota_driver.GenASensorOperationConfig()
    made_up.genA_sensor_operation_params.app_mode = made_up.genA_sensor_operation_params.app_submode = 0
    return made_up


driver = bota_driver.BotaDriver(configuration(sys.argv[1]))
if not (driver.configure() and driver.activate()):
    sys.exit("the sensor does not start")
while True:
    frame = driver.read_frame_blocking()
    (fx, fy, fz), (mx, my, mz) = map(float, frame.force), map(float, frame.torque)
    row = {"time_us": frame.timestamp, "fx_n": fx, "fy_n": fy, "fz_n": fz, "mx_nm": mx, "my_nm": my, "mz_nm": mz}
    print(json.dumps(row), flush=True)

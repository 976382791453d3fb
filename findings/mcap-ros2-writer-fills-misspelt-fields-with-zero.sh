#!/usr/bin/env bash
# Question: a script writes a WrenchStamped with mcap_ros2.writer from a dictionary whose moment is called "moment" (the
# field is "torque") and whose z axis is called "Z". What is in the bag?
# Good guess: an error that names the field that the message type does not have, or the one that is missing.
# True: the message is written without an error. Names that the type does not have are dropped, fields that are not given
# are 0: the torque is (0, 0, 0) N m and the force has no z.
# Package: mcap-ros2-support 0.6.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mcap-ros2-support==0.6.0 mcap==1.6.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import io

from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer

BREAK = "=" * 80
DEFINITION = f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{BREAK}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{BREAK}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{BREAK}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{BREAK}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""

bag = io.BytesIO()
writer = Writer(bag)
schema = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", DEFINITION)
message = {
    "header": {"stamp": {"sec": 7, "nanosec": 500_000_000}, "frame_id": "sensor"},
    "wrench": {"force": {"x": 1.0, "y": 2.0, "Z": 3.0}, "moment": {"x": 0.1, "y": 0.2, "z": 0.3}},
}
writer.write_message("/wrench", schema, message, log_time=7_500_000_000)
writer.finish()
bag.seek(0)
[found] = [entry.ros_msg.wrench for entry in read_ros2_messages(bag)]
print(found)
assert (found.force.x, found.force.y, found.force.z) == (1.0, 2.0, 0.0)
assert (found.torque.x, found.torque.y, found.torque.z) == (0.0, 0.0, 0.0)
PYTHON

"""`python -m shellcal.ros2`, received by a process that only knows ROS 2's conventions."""

from __future__ import annotations

import csv
import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest

import shellcal

from conftest import program, record_whole

pytest.importorskip("cyclonedds")

#: Independent of shellcal: types, names and quality of service are those of rmw_cyclonedds_cpp.
LISTENER = '''
import json, sys, time
from dataclasses import dataclass
from cyclonedds.core import Qos, Policy
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, int64, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32

@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str

@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float
    y: float
    z: float

@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3

@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench

@dataclass
class Request(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    guid: uint64
    seq: int64
    structure_needs_at_least_one_member: uint8

@dataclass
class Response(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    guid: uint64
    seq: int64
    success: bool
    message: str

qos = Qos(
    Policy.Reliability.Reliable(100_000_000), Policy.Durability.Volatile, Policy.History.KeepLast(10),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
everything = Qos(Policy.Reliability.Reliable(100_000_000), Policy.History.KeepAll, Policy.DataRepresentation(use_cdrv0_representation=True))
node = DomainParticipant(int(sys.argv[1]))
wrench = DataReader(node, Topic(node, "rt/forces/left", WrenchStamped, qos=everything), qos=everything)
std = DataReader(node, Topic(node, "rt/forces/left_std", WrenchStamped, qos=everything), qos=everything)
ask = DataWriter(node, Topic(node, "rq/forces/left/tareRequest", Request, qos=qos), qos=qos)
answer = DataReader(node, Topic(node, "rr/forces/left/tareReply", Response, qos=qos), qos=qos)
print("ready", flush=True)
rows, errors, answers, asked = [], 0, [], False
deadline = time.monotonic() + 120
while time.monotonic() < deadline and not (answers and len(rows) > 300):
    for sample in wrench.take(1000):
        stamp, frame = sample.header.stamp, sample.header.frame_id
        force, torque = sample.wrench.force, sample.wrench.torque
        rows.append([stamp.sec, stamp.nanosec, frame, force.x, force.y, force.z, torque.x, torque.y, torque.z])
    errors += len(std.take(1000))
    answers += [[it.guid, it.seq, it.success] for it in answer.take(10)]
    if len(rows) > 100 and not asked:
        ask.write(Request(2**63 + 5, 7, 0))
        asked = True
    time.sleep(0.01)
print(json.dumps({"rows": rows, "errors": errors, "answers": answers}), flush=True)
'''


def test_a_node_of_ros_2_gets_wrenches_and_can_tare(logs: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "cal.json"
    program("fit", logs[1], "--model", "cubic", "-o", path, "-q")
    # A domain that other tests on this machine are unlikely to use.
    domain = str(1 + os.getpid() % 200)
    with (
        shellcal.simulated_board(load="-") as board,
        subprocess.Popen(
            [sys.executable, "-c", LISTENER, domain], stdout=subprocess.PIPE, text=True
        ) as listener,
    ):
        assert listener.stdout is not None and listener.stdout.readline() == "ready\n"
        # fmt: off
        node = subprocess.Popen([
            sys.executable, "-m", "shellcal.ros2", board.port, "--calibration", str(path),
            "--topic", "/forces/left", "--frame", "left_foot", "--domain", domain,
        ])
        # fmt: on
        try:
            heard = json.loads(listener.stdout.read())
        finally:
            node.terminate()
            assert node.wait() == 0
    rows = heard["rows"]
    assert len(rows) > 300 and heard["errors"] > 200
    assert heard["answers"] == [[2**63 + 5, 7, True]]
    assert all(row[2] == "left_foot" for row in rows)
    stamps = [row[0] + row[1] / 1e9 for row in rows]
    # 100 Hz, to a µs of the stamps and a double's resolution. A reader that is late by ten frames misses
    # some, since ROS 2 keeps that many.
    periods = [(b - a) / 0.01 for a, b in zip(stamps, stamps[1:])]
    assert all(0 < round(it) and abs(it - round(it)) < 2e-4 for it in periods), max(periods)


def test_a_frame_has_the_same_bits_in_log_stream_loop_and_message(
    logs: list[Path], tmp_path: Path
) -> None:
    from shellcal._stream import Frame
    from shellcal.ros2 import RELIABLE, Node

    path, log, rows = (tmp_path / name for name in ("cal.json", "run.csv", "rows.jsonl"))
    program("fit", logs[1], "--model", "cubic", "-o", path, "-q")
    with shellcal.simulated_board(seed=6) as board:
        record_whole(board.port, path, log, stream=rows)
    with open(log, encoding="utf-8") as file:
        recorded = {int(row["index"]): row for row in csv.DictReader(file)}
    node = Node("/forces/bits", "shell", 1 + os.getpid() % 200, RELIABLE)
    node._start = 0.0
    frames = [Frame(line) for line in rows.read_bytes().splitlines()]
    assert len(frames) > 200
    for frame in frames:
        row = recorded[frame.index]
        wrench = [float(row[name]) for name in ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")]
        assert frame.wrench.tolist() == wrench
        seconds, microseconds = map(int, row["t_s"].split("."))
        message = node._stamped(frame, frame.wrench).serialize(use_version_2=False)
        # CDR version 1, little-endian: header, stamp, length and text, padding to 8, six doubles.
        head = struct.pack("<iII6s6x", seconds, microseconds * 1000, 6, b"shell\0")
        assert message == b"\x00\x01\x00\x00" + head + struct.pack("<6d", *wrench)

"""The program's MCAP files of a log and of a recording, read by `rosbags`, an independent implementation."""

from __future__ import annotations

import csv
import io
import os
import struct
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import program, record_whole

import shellcal

pytest.importorskip("rosbags")


def test_a_recording_opens_with_the_types_of_ros_2(logs: list[Path], tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    calibration, log, bag = tmp_path / "cal.json", tmp_path / "zero.csv", tmp_path / "bag.mcap"
    program("fit", logs[1], "--model", "cubic", "-o", calibration, "-q")
    program("synth zero", "--rows", 200, "-o", log)
    mount = "--mount=base_link:0.1,0,-0.02,0,0,1.5707963267948966"
    program("convert", calibration, log, "-o", bag, mount, "--frame-id", "left_shell")
    table = shellcal.convert(calibration, log)
    standard = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([bag]) as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        # The definitions in the file are those of ROS 2.
        for topic, kind in (
            ("/wrench", "geometry_msgs/msg/WrenchStamped"),
            ("/tf_static", "tf2_msgs/msg/TFMessage"),
        ):
            assert topics[topic].msgtype == kind
            own = reader.typestore.generate_msgdef(kind)
            assert own == standard.generate_msgdef(kind)
        wrenches = []
        for connection, time_ns, data in reader.messages([topics["/wrench"]]):
            message = standard.deserialize_cdr(data, connection.msgtype)
            assert message.header.frame_id == "left_shell"
            stamp = message.header.stamp
            assert stamp.sec * 1_000_000_000 + stamp.nanosec == time_ns
            force, torque = message.wrench.force, message.wrench.torque
            wrenches.append([force.x, force.y, force.z, torque.x, torque.y, torque.z])
        [(connection, time_ns, data)] = reader.messages([topics["/tf_static"]])
        # ROS reads a stamp of 0 as "no time".
        assert time_ns == 1
        [found] = standard.deserialize_cdr(data, connection.msgtype).transforms
        details = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages([topics["/wrench/details"]])
        ]
    names = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
    assert np.array_equal(np.array(wrenches), np.stack([table[name] for name in names], axis=1))
    assert (found.header.frame_id, found.child_frame_id) == ("base_link", "left_shell")
    place, rotation = found.transform.translation, found.transform.rotation
    assert (place.x, place.y, place.z) == (0.1, 0.0, -0.02)
    # A quarter turn about z; cosine and sine of 45° with this machine's rounding.
    turn = [rotation.x, rotation.y, rotation.z, rotation.w]
    assert np.allclose(turn, [0, 0, 0.5**0.5, 0.5**0.5], rtol=0, atol=1e-15)
    assert len(details) == 200
    assert np.array_equal([row.fx_se_n for row in details], table["fx_se_n"])


@pytest.mark.skipif(os.name == "nt", reason="ports that a program makes are not there")
def test_a_recording_of_a_board_is_a_bag_with_the_same_bits(logs: list[Path], tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    calibration, log, bag = tmp_path / "cal.json", tmp_path / "run.csv", tmp_path / "run.mcap"
    program("fit", logs[1], "--model", "cubic", "-o", calibration, "-q")
    with shellcal.simulated_board(seed=8) as board:
        record_whole(board.port, calibration, log)
    program("convert", calibration, log, "--causal", "--all-rows", "--mount", "base_link", "-o", bag)
    with open(log, encoding="utf-8") as rows:
        recorded = list(csv.DictReader(rows))
    with AnyReader([bag]) as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        assert len(list(reader.messages([topics["/tf_static"]]))) == 1
        found = {}
        for connection, time_ns, data in reader.messages([topics["/wrench"]]):
            wrench = reader.deserialize(data, connection.msgtype).wrench
            force, torque = wrench.force, wrench.torque
            found[time_ns] = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    assert len(recorded) == len(found) > 200
    names = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
    # Until tare and clock are known, the log has the forces of the calibration alone.
    known = [row for row in recorded if not {"untared", "unfiltered"} & set(row["flags"].split())]
    assert len(known) > 150
    for row in known:
        time_ns = int(row["t_s"].replace(".", "")) * 1000
        assert found[time_ns] == [float(row[name]) for name in names]


#: The definition of a wrench without a header.
WRENCH = f"""geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{"=" * 80}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def bag_of_wrenches(messages: list[bytes], finished: bool, compression: Any) -> bytes:
    """A recording of one topic in chunks of some ten messages, as the package `mcap` writes it."""
    from mcap.writer import Writer

    file = io.BytesIO()
    writer = Writer(file, chunk_size=1000, compression=compression)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema("geometry_msgs/msg/Wrench", "ros2msg", WRENCH.encode())
    channel = writer.register_channel("/wrench", "cdr", schema)
    for number, data in enumerate(messages):
        stamp = 1_000_000_000 + 10_000_000 * number
        writer.add_message(channel, stamp, data, stamp)
    if finished:
        writer.finish()
    return file.getvalue()


@pytest.mark.parametrize("name", ["NONE", "LZ4", "ZSTD"])
def test_the_bag_of_a_killed_recorder_is_read_up_to_the_cut(name: str, tmp_path: Path) -> None:
    from mcap.exceptions import McapError
    from mcap.records import Message
    from mcap.stream_reader import StreamReader
    from mcap.writer import CompressionType

    messages = [
        bytes([0, 1, 0, 0]) + struct.pack("<6d", k, 0, -1, 0.1, 0.2, 0.3) for k in range(200)
    ]
    whole = bag_of_wrenches(messages, True, CompressionType[name])
    killed = bag_of_wrenches(messages, False, CompressionType[name])
    for cut in (killed, killed[:-100], whole[: len(whole) // 2]):
        held = []
        try:
            for record in StreamReader(io.BytesIO(cut)).records:
                held += [record] if isinstance(record, Message) else []
        except (McapError, EOFError, struct.error):
            pass
        assert 50 < len(held) < len(messages)
        path = tmp_path / "run.mcap"
        path.write_bytes(cut)
        assert f"  rows      {len(held)}" in (said := program("info", path)), said
        assert "the file is cut off" in said


def test_a_bag_in_another_version_of_cdr_is_read_or_refused_by_name(tmp_path: Path) -> None:
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.annotations import appendable, final, mutable
    from cyclonedds.idl.types import float64
    from mcap.writer import CompressionType

    def idl(annotation: Any, name: str, fields: dict[str, Any]) -> Any:
        body = {"__annotations__": fields, "__module__": __name__}
        kind = {"typename": f"geometry_msgs::msg::dds_::{name}_"}
        made = types.new_class(name, (IdlStruct,), kind, lambda namespace: namespace.update(body))
        return dataclass(annotation(made))

    for annotation, refused in ((final, None), (appendable, "D_CDR2"), (mutable, "PL_CDR2")):
        vector = idl(annotation, "Vector3", {axis: float64 for axis in "xyz"})
        wrench = idl(annotation, "Wrench", {"force": vector, "torque": vector})
        message = wrench(vector(1.0, 2.0, 3.0), vector(0.1, 0.2, 0.3))
        data = message.serialize(use_version_2=True)
        path = tmp_path / "run.mcap"
        path.write_bytes(bag_of_wrenches([data] * 20, True, CompressionType.NONE))
        done = subprocess.run(
            [shellcal.program(), "info", path], capture_output=True, text=True, check=False
        )
        if refused is None:
            assert done.returncode == 0 and "  rows      20" in done.stdout, done.stderr
        else:
            assert done.returncode == 2 and refused in done.stderr, done.stderr


def test_readers_that_do_not_know_the_program_take_its_bags(logs: list[Path], tmp_path: Path) -> None:
    calibration, bag = tmp_path / "cal.json", tmp_path / "run.mcap"
    program("fit", logs[1], "--model", "cubic", "-o", calibration, "-q")
    program("convert", calibration, logs[1], "-o", bag, "--mount", "base_link")
    scripts = Path(sys.executable).parent
    for command, expected in (
        (["baglint", "--init", bag], "/wrench/details:"),
        (["clockdoctor", bag, "--out-dir", tmp_path / "clock"], "header 0.000 / 0.000 / 0.000 / 0.000"),
        (["pymcap-cli", "doctor", bag], "passed MCAP doctor checks"),
        (["pymcap-cli", "cat", bag], '"schema":"shellcal_msgs/msg/Record"'),
    ):
        done = subprocess.run(
            [scripts / command[0], *command[1:]], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        # Lines are wrapped to the width of a terminal.
        assert expected in " ".join(done.stdout.split()), f"{command}: {done.stdout}"

"""Wrenches for ROS 2, without an installed ROS: ``python -m shellcal.ros2 PORT --calibration cal.json``.

Publishes over DDS with the package ``cyclonedds`` (``pip install shellcal[ros2]``), with the names, types and quality of
service of ROS 2's middleware:

=================  =======================================  ==========================================
ROS 2              DDS topic                                DDS type
=================  =======================================  ==========================================
``/wrench``        ``rt/wrench``                            ``geometry_msgs::msg::dds_::WrenchStamped_``
``/wrench_std``    ``rt/wrench_std``                        the same, with the standard errors
``/wrench/tare``   ``rq/wrench/tareRequest``                ``std_srvs::srv::dds_::Trigger_Request_``
                   ``rr/wrench/tareReply``                  ``std_srvs::srv::dds_::Trigger_Response_``
=================  =======================================  ==========================================

Requests and replies begin with the numbers of the client and of the request, as in ``rmw_cyclonedds_cpp``; other ROS 2
middlewares are compatible for topics, not for services.
"""

import argparse
import os
import signal
import sys
import time
from dataclasses import dataclass
from typing import Any

from ._errors import ShellcalError
from ._stream import Frame, FrameStream, stream

try:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.annotations import final
    from cyclonedds.idl.types import int32, int64, uint8, uint32, uint64
    from cyclonedds.pub import DataWriter, Publisher
    from cyclonedds.sub import DataReader, Subscriber
    from cyclonedds.topic import Topic
except ImportError as error:
    raise ImportError(f"{error}; `pip install shellcal[ros2]` installs it") from None


# `cyclonedds` cannot resolve postponed annotations, so this file has none.


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
@final
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float
    y: float
    z: float


@dataclass
@final
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
@final
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
@final
class TriggerRequest(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Request_"):
    guid: uint64
    seq: int64
    structure_needs_at_least_one_member: uint8 = 0


@dataclass
@final
class TriggerResponse(IdlStruct, typename="std_srvs::srv::dds_::Trigger_Response_"):
    guid: uint64
    seq: int64
    success: bool
    message: str


#: XCDR version 1, which ROS 2 writes.
_CLASSIC = Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)

#: Default quality of ROS 2's publishers (``rmw_qos_profile_default``), and of its services.
RELIABLE = Qos(
    Policy.Reliability.Reliable(100_000_000),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
    _CLASSIC,
)

#: Quality of ROS 2's sensor publishers (``rmw_qos_profile_sensor_data``).
SENSOR = Qos(
    Policy.Reliability.BestEffort,
    Policy.Durability.Volatile,
    Policy.History.KeepLast(5),
    _CLASSIC,
)


class Node:
    """The publishers and the service."""

    def __init__(self, topic: str, frame_id: str, domain: int, qos: Qos) -> None:
        name = topic.strip("/")
        self._frame_id = frame_id
        self._participant = DomainParticipant(domain)
        publisher, subscriber = Publisher(self._participant), Subscriber(self._participant)
        self._wrench = self._writer(publisher, f"rt/{name}", WrenchStamped, qos)
        self._std = self._writer(publisher, f"rt/{name}_std", WrenchStamped, qos)
        self._reply = self._writer(publisher, f"rr/{name}/tareReply", TriggerResponse, RELIABLE)
        request = Topic(self._participant, f"rq/{name}/tareRequest", TriggerRequest, qos=RELIABLE)
        self._request: Any = DataReader(subscriber, request, qos=RELIABLE)
        self._waiting: list[TriggerRequest] = []
        self._start: float | None = None

    def _writer(self, publisher: Publisher, name: str, kind: Any, qos: Qos) -> Any:
        return DataWriter(publisher, Topic(self._participant, name, kind, qos=qos), qos=qos)

    def publish(self, frame: Frame) -> None:
        """Publishes a frame; its stamp is the board's clock, set by this computer's at the first frame."""
        if frame.wrench is None:
            raise ShellcalError("there are no wrenches: name a calibration by `--calibration`")
        if self._start is None:
            self._start = frame.host_t - frame.t
        self._wrench.write(self._stamped(frame, frame.wrench))
        if frame.std is not None:
            self._std.write(self._stamped(frame, frame.std))

    def _stamped(self, frame: Frame, values: Any) -> WrenchStamped:
        assert self._start is not None
        microseconds = round((self._start + frame.t) * 1e6)
        stamp = Time(microseconds // 1_000_000, microseconds % 1_000_000 * 1000)
        numbers = [float(value) for value in values]
        wrench = Wrench(Vector3(*numbers[:3]), Vector3(*numbers[3:]))
        return WrenchStamped(Header(stamp, self._frame_id), wrench)

    def serve(self, frames: FrameStream, frame: Frame) -> None:
        """Begins a requested tare, and replies when `frame` is the first frame with it."""
        requests = self._request.take(16)
        if requests:
            self._waiting += requests
            frames.tare()
        if "tared" in frame.flags:
            for request in self._waiting:
                self._reply.write(TriggerResponse(request.guid, request.seq, True, "tared"))
            self._waiting.clear()


def _arguments(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m shellcal.ros2", description="Publish wrenches for ROS 2 over DDS."
    )
    parser.add_argument("source", metavar="PORT|LOG", help="serial port, or a log to play")
    parser.add_argument("--calibration", metavar="CAL", required=True, help="calibration for forces")
    parser.add_argument("--topic", default="/wrench", help="[default: %(default)s]")
    parser.add_argument("--frame", default="shell", help="frame of the wrenches [default: %(default)s]")
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    parser.add_argument("--domain", type=int, default=domain, help="[default: ROS_DOMAIN_ID, or 0]")
    parser.add_argument(
        "--best-effort", action="store_true", help="as sensors are published, in place of reliably"
    )
    parser.add_argument("--lowpass", type=float, metavar="HZ", help="cutoff of the low-pass")
    parser.add_argument("--no-lowpass", action="store_true", help="do not filter")
    parser.add_argument("--no-tare", action="store_true", help="subtract nothing at the start")
    parser.add_argument("--rate", type=float, metavar="HZ", help="wrenches per second, at most")
    parser.add_argument("--reconnect", action="store_true", help="wait for a port that goes away")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Runs until Ctrl-C, or until the source ends."""
    given = _arguments(words)
    qos = SENSOR if given.best_effort else RELIABLE
    options = {
        name: getattr(given, name)
        for name in ("lowpass", "no_lowpass", "no_tare", "rate", "reconnect")
    }
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        with stream(given.source, given.calibration, **options) as frames:
            node = Node(given.topic, given.frame, given.domain, qos)
            for frame in frames:
                node.publish(frame)
                node.serve(frames, frame)
            # Gives reliable readers time to receive pending messages.
            time.sleep(0.1)
    except KeyboardInterrupt:
        pass
    except ShellcalError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

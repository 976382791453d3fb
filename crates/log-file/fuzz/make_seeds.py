"""Writes one recording in every kind of file that is read, by the programs that people write them with.

    pip install numpy scipy polars pandas pyarrow openpyxl odfpy mcap-ros2-support h5py nptdms rosbags
    python make_seeds.py

The files are seeds of the fuzz targets, and what tests/kinds_of_file.rs compares.
"""

import datetime
import gzip
import itertools
import json
import pathlib
import shutil
import struct
import tempfile

import h5py
import numpy as np
import openpyxl
import polars as pl
import pyarrow as pa
import pyarrow.parquet as parquet
import scipy.io
from backports import zstd
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from odf import table as odf
from odf.office import Annotation
from odf.opendocument import OpenDocumentSpreadsheet
from odf.text import P
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

ROWS = 24
SEEDS = pathlib.Path(__file__).parent / "seeds"
AXES = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
WRENCH_STAMPED = """std_msgs/Header header
geometry_msgs/Wrench wrench
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
===
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""

random = np.random.default_rng(1)
time = np.arange(ROWS) / 100
readings = random.integers(500, 3500, size=(ROWS, 8))
# Few digits, because a workbook keeps at most 15.
wrench = np.round((readings - 2000) @ random.normal(size=(8, 6)) / 1000, 4)
groups = [f"pose {row // 6}" for row in range(ROWS)]
table = pl.DataFrame(
    {"t_s": time}
    | {f"s{i + 1}": readings[:, i] for i in range(8)}
    | {axis: wrench[:, i] for i, axis in enumerate(AXES)}
    | {"group": groups}
)
names, rows = table.columns, table.rows()
matrix = np.column_stack([time, readings, wrench])


def at(kind, name):
    (SEEDS / kind).mkdir(parents=True, exist_ok=True)
    return SEEDS / kind / name


def lines(separator, rows, text=str):
    return "".join(separator.join(map(text, row)) + "\r\n" for row in rows)


def german(value):
    return str(value) if isinstance(value, str) else str(value).replace(".", ",")


csv = table.write_csv().encode()
at("text", "plain.csv").write_bytes(csv)
at("text", "bom.csv").write_bytes(b"\xef\xbb\xbf" + csv)
at("text", "german.csv").write_text(lines(";", [names]) + lines(";", rows, german), newline="")
at("text", "german_utf16.csv").write_text(
    lines(";", [names]) + lines(";", rows, german), encoding="utf-16", newline=""
)
units = ["s"] + ["counts"] * 8 + ["N"] * 3 + ["N·m"] * 3 + [""]
at("text", "units.csv").write_text("# made by hand\n" + lines(",", [names, units, *rows]), newline="")
start = datetime.datetime(2026, 11, 22, 10, 0, 0)
dates = [[(start + datetime.timedelta(seconds=row[0])).isoformat(), *row[1:]] for row in rows]
at("text", "dates.csv").write_text(
    lines(",", [["time", *names[1:]], *dates[:5], ["# a remark"], *dates[5:]]), newline=""
)
np.savetxt(at("text", "savetxt.csv"), matrix, "%.17g", ",", header=",".join(names[:-1]))
at("packed", "plain.csv.gz").write_bytes(gzip.compress(csv, mtime=0))
half = len(csv) // 2
at("packed", "plain.csv.zst").write_bytes(zstd.compress(csv))
at("packed", "frames.csv.zst").write_bytes(
    zstd.compress(csv[:half]) + b"\x50\x2a\x4d\x18\x03\0\0\0abc" + zstd.compress(csv[half:], 19)
)

arrow = table.to_arrow()
for codec in ["zstd", "snappy", "gzip", "lz4"]:
    table.write_parquet(at("parquet", f"polars_{codec}.parquet"), compression=codec)
parquet.write_table(arrow, at("parquet", "snappy.parquet"))
parquet.write_table(arrow, at("parquet", "pages_v2.parquet"), data_page_version="2.0")
parquet.write_table(arrow, at("parquet", "groups.parquet"), row_group_size=7, use_dictionary=False)
parquet.write_table(
    arrow, at("parquet", "split.parquet"), use_dictionary=["group"], use_byte_stream_split=["Fx", "t_s"]
)
parquet.write_table(
    arrow,
    at("parquet", "delta.parquet"),
    use_dictionary=False,
    column_encoding={"s1": "DELTA_BINARY_PACKED", "s2": "DELTA_BINARY_PACKED"},
)

columns = {axis: wrench[:, i] for i, axis in enumerate(AXES)}
lists = pa.FixedSizeListArray.from_arrays(pa.array(readings.ravel()), 8)
listed = pa.table({"t_s": time, "s": lists} | columns | {"group": groups})
parquet.write_table(listed, at("parquet", "lists.parquet"), row_group_size=10)
parquet.write_table(listed, at("parquet", "lists_v2.parquet"), data_page_version="2.0", data_page_size=100)

scipy.io.savemat(at("matlab", "matrix.mat"), {"data": matrix})
scipy.io.savemat(at("matlab", "matrix_compressed.mat"), {"data": matrix}, do_compression=True)
scipy.io.savemat(
    at("matlab", "vectors.mat"), {"t": time, "s": readings.astype(np.int16), "rate": 100.0, "note": "x"} | columns
)
# A struct with texts; and time along the columns, together with an unrelated matrix.
fields = {"t": time, "s": readings.astype(float)} | columns | {"group": np.array(groups, dtype=object)}
scipy.io.savemat(at("matlab", "struct.mat"), {"run": fields, "rotation": np.eye(3)}, do_compression=True)
scipy.io.savemat(
    at("matlab", "sideways.mat"),
    {"t": time, "s": readings.T.astype(float), "group": groups, "ft": np.zeros(7)} | columns,
)
# Every layout of a data set, chunk index, filter and byte order.
for name, version, kind, how in [
    ("contiguous", "earliest", "<f8", {}),
    ("big_endian", "v110", ">f8", {}),
    ("chunked", "earliest", "<f8", {"chunks": True}),
    ("gzip", "earliest", "<f8", {"compression": "gzip"}),
    ("gzip_shuffle", "v110", "<f8", {"compression": "gzip", "shuffle": True}),
    ("one_piece", "v110", "<f8", {"chunks": True, "fletcher32": True}),
    ("fixed_array", "v110", "<f8", {"chunks": 7, "compression": "gzip"}),
    ("growing", "v110", "<f8", {"chunks": 7, "maxshape": None, "shuffle": True}),
]:
    with h5py.File(at("hdf5", f"{name}.h5"), "w", libver=(version, "v114")) as file:
        run = file.create_group("run") if name == "gzip" else file
        for column, values in ({"t": time, "s": readings} | columns).items():
            values = np.asarray(values)
            options = dict(how)
            if options.get("chunks") == 7:
                options["chunks"] = (7,) + tuple(min(5, side) for side in values.shape[1:])
            if "maxshape" in options:
                options["maxshape"] = (None,) + values.shape[1:]
            of = "u2" if column == "s" else kind
            run.create_dataset(column, data=values.astype(kind[0] + of[-2:]), **options)
        run.attrs["rate"] = 100.0
        run.create_dataset("note", data="made by hand")
        run.create_dataset("matrix_of_fit", data=np.eye(8, 6))
with h5py.File(at("hdf5", "by_shape.h5"), "w") as file:
    file["t"], file["cells"], file["ft"] = time, readings, wrench
# Texts, booleans, units, 12-bit readings along the columns, and links to nothing and to other places.
with h5py.File(at("hdf5", "texts.h5"), "w") as file:
    file["t"] = np.arange(ROWS) * 10
    file["t"].attrs["units"] = "milliseconds since 2026-11-22 10:00:00"
    twelve = h5py.h5t.NATIVE_UINT16.copy()
    twelve.set_precision(12)
    stored = h5py.h5d.create(file.id, b"s", twelve, h5py.h5s.create_simple((8, ROWS)))
    stored.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(readings.T, dtype="u2"))
    for axis in AXES:
        file[axis] = columns[axis]
        file[axis].attrs["unit"] = "N" if axis[0] == "F" else "N*m"
    file["group"] = groups
    file["is_moving"] = readings[:, 0] > 2000
    file["latest"], file["gone"] = h5py.SoftLink("/t"), h5py.SoftLink("/nowhere")
with h5py.File(at("hdf5", "compact.h5"), "w") as file:
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_layout(h5py.h5d.COMPACT)
    for column, values in ({"t": time, "s": readings} | columns).items():
        values = np.ascontiguousarray(values, dtype="<f8")
        space = h5py.h5s.create_simple(values.shape)
        made = h5py.h5d.create(file.id, column.encode(), h5py.h5t.IEEE_F64LE, space, plist)
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, values)
# MATLAB stores matrices column by column, and texts as numbers.
with h5py.File(at("hdf5", "matlab73.mat"), "w", userblock_size=512) as file:
    for column, values, kind in [
        ("t", time, "double"),
        ("s", readings.astype(np.int16), "int16"),
        ("note", np.arange(ROWS, dtype=np.uint16), "char"),
        *((axis, columns[axis], "double") for axis in AXES),
    ]:
        stored = file.create_dataset(column, data=np.atleast_2d(values.T), compression="gzip")
        stored.attrs["MATLAB_class"] = np.bytes_(kind)
with open(at("hdf5", "matlab73.mat"), "r+b") as file:
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Sun Nov 22 10:00:00 2026 HDF5 schema 1.00 ."
    file.write(text.ljust(116) + bytes(8) + b"\0\x02IM")
np.save(at("numpy", "matrix.npy"), matrix)
np.save(at("numpy", "by_column.npy"), np.asfortranarray(matrix))
fields = [("t_s", "<f8"), ("s", "<u2", (8,))] + [(axis, ">f8") for axis in AXES] + [("group", "U6")]
record = np.zeros(ROWS, dtype=fields)
record["t_s"], record["s"], record["group"] = time, readings, groups
for axis in AXES:
    record[axis] = columns[axis]
np.save(at("numpy", "records.npy"), record)

workbook = openpyxl.Workbook()
for row in [names, *rows]:
    workbook.active.append(row)
workbook.save(at("xlsx", "workbook.xlsx"))
# A sheet without a log, notes next to the rows, and an elapsed time.
workbook = openpyxl.Workbook()
workbook.active.append(["recorded on", "a Sunday"])
workbook.active.append(["rig", 7])
sheet = workbook.create_sheet("run")
sheet.append(["time", *names[1:]])
for row in rows:
    sheet.append([datetime.timedelta(seconds=row[0]), *row[1:], None, "quiet"])
workbook.save(at("xlsx", "notes.xlsx"))

# A sheet by pandas; and a sheet as LibreOffice stores it, with a title, units, notes beside the rows, equal cells
# stored once, and an elapsed time.
table.to_pandas().to_excel(at("ods", "pandas.ods"), engine="odf", index=False)
document = OpenDocumentSpreadsheet()


def sheet_row(sheet, values, empty, repeat=1):
    row = odf.TableRow(numberrowsrepeated=repeat)
    for value, equal in itertools.groupby(values):
        cell = odf.TableCell(numbercolumnsrepeated=len(list(equal)))
        if isinstance(value, datetime.timedelta):
            cell.setAttribute("valuetype", "time")
            cell.setAttribute("timevalue", f"PT00H00M{value.total_seconds():012.9f}S")
        elif isinstance(value, str):
            cell.setAttribute("valuetype", "string")
            if value == "time":
                comment = Annotation()
                comment.addElement(P(text="a comment"))
                cell.addElement(comment)
            cell.addElement(P(text=value))
        elif value is not None:
            cell.setAttribute("valuetype", "float")
            cell.setAttribute("value", value)
        row.addElement(cell)
    row.addElement(odf.TableCell(numbercolumnsrepeated=empty))
    sheet.addElement(row)


sheet = odf.Table(name="notes")
sheet_row(sheet, ["recorded on a Sunday"], 16383)
document.spreadsheet.addElement(sheet)
sheet = odf.Table(name="run")
sheet_row(sheet, ["session 3, rig 7"], 16383)
sheet_row(sheet, [], 16384, repeat=2)
sheet_row(sheet, [None, "time", *names[1:]], 16367)
sheet_row(sheet, [None, "s"] + ["counts"] * 8 + ["N"] * 3 + ["N·m"] * 3, 16369)
for row in rows:
    elapsed = datetime.timedelta(seconds=row[0])
    sheet_row(sheet, [None, elapsed, *row[1:], None, None, "quiet"] if row[1] % 2 else [None, elapsed, *row[1:]], 9)
sheet_row(sheet, [], 16384, repeat=1_048_547)
document.spreadsheet.addElement(sheet)
document.save(at("ods", "libreoffice.ods"))

for codec in [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]:
    with open(at("mcap", f"{codec.name.lower()}.mcap"), "wb") as file:
        writer = Writer(file, compression=codec)
        schema = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH_STAMPED)
        json_schema = writer._writer.register_schema("readings", "jsonschema", b'{"type": "object"}')
        channel = writer._writer.register_channel("/readings", "json", json_schema)
        for row in range(ROWS):
            ns = 1_700_000_000_000_000_000 + 10_000_000 * row
            axes = [float(value) for value in wrench[row]]
            stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
            message = {
                "header": {"stamp": stamp, "frame_id": "shell"},
                "wrench": {"force": dict(zip("xyz", axes[:3])), "torque": dict(zip("xyz", axes[3:]))},
            }
            writer.write_message("/wrench", schema, message, ns, ns)
            data = {"s": [int(value) for value in readings[row]], "group": groups[row]}
            writer._writer.add_message(channel, ns, json.dumps(data).encode(), ns)
        writer.finish()
# Messages out of order, in big-endian byte order.
with open(at("mcap", "shuffled.mcap"), "wb") as file:
    writer = McapWriter(file)
    writer.start()
    schema = writer.register_schema("geometry_msgs/msg/WrenchStamped", "ros2msg", WRENCH_STAMPED.encode())
    channel = writer.register_channel("/wrench", "cdr", schema)
    json_channel = writer.register_channel("/readings", "json", 0)
    for row in random.permutation(ROWS):
        ns = 1_700_000_000_000_000_000 + 10_000_000 * int(row)
        head = struct.pack(">4B2iI", 0, 0, 0, 0, ns // 10**9, ns % 10**9, 6) + b"shell\0" + bytes(6)
        writer.add_message(channel, ns, head + struct.pack(">6d", *wrench[row]), ns)
        data = {"s": [int(value) for value in readings[row]], "group": groups[row]}
        writer.add_message(json_channel, ns, json.dumps(data).encode(), ns)
    writer.finish()

# A waveform in pieces, and times of LabVIEW with texts.
units = dict(zip(AXES, ["N"] * 3 + ["N·m"] * 3))
for name, pieces, clock in [("waveform.tdms", 3, []), ("times.tdms", 1, ["time", "group"])]:
    with TdmsWriter(at("tdms", name)) as writer:
        for rows_of in np.array_split(np.arange(ROWS), pieces):
            wave = {} if clock else {"wf_increment": 0.01, "wf_start_offset": 0.0}
            stamps = np.datetime64(start, "us") + (time[rows_of] * 1e6).astype("timedelta64[us]")
            channels = [ChannelObject("run", "time", stamps)] if clock else []
            channels += [ChannelObject("run", f"s{i + 1}", readings[rows_of, i].astype("i2"), wave) for i in range(8)]
            channels += [
                ChannelObject("run", axis, columns[axis][rows_of], wave | {"unit_string": units[axis]}) for axis in AXES
            ]
            if clock:
                channels.append(ChannelObject("run", "group", [groups[row] for row in rows_of]))
            writer.write_segment(channels)

# Samples of two measurement cards (DAQmx), which npTDMS reads but no package writes: rows of integers, then of
# doubles. The first scale of a channel is the card's own.
def tdms_text(text):
    return struct.pack("<I", len(text)) + text.encode()


def tdms_channel(name, kind, card, offset, rows_of):
    index = struct.pack("<IIIQI5I3I", 0x1269, 0xFFFFFFFF, 1, rows_of, 1, kind, card, offset, 0, 0, 2, 16, 48)
    properties = b"".join(
        tdms_text(key) + (struct.pack("<I", 0x20) + tdms_text(value) if isinstance(value, str) else value)
        for key, value in {
            "NI_Scaling_Status": "unscaled",
            "NI_Number_Of_Scales": struct.pack("<II", 7, 2),
            "NI_Scale[1]_Scale_Type": "Linear",
            "NI_Scale[1]_Linear_Slope": struct.pack("<Id", 10, 1.0),
            "NI_Scale[1]_Linear_Y_Intercept": struct.pack("<Id", 10, 0.0),
            "NI_Scale[1]_Linear_Input_Source": struct.pack("<II", 7, 0),
            "wf_increment": struct.pack("<Id", 10, 0.01),
        }.items()
    )
    return tdms_text(f"/'run'/'{name}'") + index + struct.pack("<I", 7) + properties


chunk = 10
channels = [tdms_channel(f"s{i + 1}", 3, 0, 2 * i, chunk) for i in range(8)]
channels += [tdms_channel(axis, 9, 1, 8 * i, chunk) for i, axis in enumerate(AXES)]
nothing = struct.pack("<II", 0xFFFFFFFF, 0)
objects = [tdms_text("/") + nothing, tdms_text("/'run'") + nothing, *channels]
objects = struct.pack("<I", len(objects)) + b"".join(objects)
whole = range(0, ROWS - ROWS % chunk, chunk)
values = b"".join(
    readings[at : at + chunk].astype("<i2").tobytes() + wrench[at : at + chunk].astype("<f8").tobytes() for at in whole
)
head = struct.pack("<4sIIQQ", b"TDSm", 2 | 4 | 8 | 128, 4713, len(objects) + len(values), len(objects))
rest = objects.replace(struct.pack("<QI", chunk, 1), struct.pack("<QI", ROWS % chunk, 1))
last = readings[whole.stop :].astype("<i2").tobytes() + wrench[whole.stop :].astype("<f8").tobytes()
tail = struct.pack("<4sIIQQ", b"TDSm", 2 | 4 | 8 | 128, 4713, len(rest) + len(last), len(rest))
at("tdms", "cards.tdms").write_bytes(head + objects + values + tail + rest + last)
read = TdmsFile.read(at("tdms", "cards.tdms"))["run"]
assert all((read[f"s{i + 1}"][:] == readings[:, i]).all() for i in range(8))
assert all((read[axis][:] == columns[axis]).all() for axis in AXES)

# Bags of ROS 1 and of ROS 2 in SQLite, with readings in JSON and a topic of remarks.
def write_bag(writer, store, serialize):
    kinds = store.types
    wrench_topic = writer.add_connection("/wrench", "geometry_msgs/msg/WrenchStamped", typestore=store)
    json_topic = writer.add_connection("/readings", "std_msgs/msg/String", typestore=store)
    remarks = writer.add_connection("/remarks", "std_msgs/msg/String", typestore=store)
    text = kinds["std_msgs/msg/String"]
    writer.write(remarks, 1_700_000_000_000_000_000, serialize(text(data="begin"), "std_msgs/msg/String"))
    for row in range(ROWS):
        ns = 1_700_000_000_000_000_000 + 10_000_000 * row
        stamp = kinds["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        head = {"stamp": stamp, "frame_id": "shell"} | ({"seq": row} if store is ros1 else {})
        vector, axes = kinds["geometry_msgs/msg/Vector3"], [float(value) for value in wrench[row]]
        message = kinds["geometry_msgs/msg/WrenchStamped"](
            header=kinds["std_msgs/msg/Header"](**head),
            wrench=kinds["geometry_msgs/msg/Wrench"](force=vector(*axes[:3]), torque=vector(*axes[3:])),
        )
        writer.write(wrench_topic, ns, serialize(message, "geometry_msgs/msg/WrenchStamped"))
        data = json.dumps({"s": [int(value) for value in readings[row]], "group": groups[row]})
        writer.write(json_topic, ns, serialize(text(data=data), "std_msgs/msg/String"))


ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
for name, codec in [("none", None), ("bz2", "BZ2"), ("lz4", "LZ4")]:
    path = at("rosbag", f"{name}.bag")
    path.unlink(missing_ok=True)
    writer = rosbag1.Writer(path)
    if codec:
        writer.set_compression(rosbag1.Writer.CompressionFormat[codec])
    with writer:
        write_bag(writer, ros1, ros1.serialize_ros1)
with tempfile.TemporaryDirectory() as folder:
    with rosbag2.Writer(pathlib.Path(folder) / "run", version=8) as writer:
        write_bag(writer, ros2, ros2.serialize_cdr)
    shutil.copy(pathlib.Path(folder) / "run" / "run.db3", at("sqlite", "bag.db3"))

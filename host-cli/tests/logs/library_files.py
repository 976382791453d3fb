"""Writes files with the libraries that define their formats, and the values that the libraries read from them.

    python library_files.py FOLDER FIRST COUNT

Each file has its own seed, its number. A line of JSON on standard output describes it: the columns to be read, in
random order and between columns of any other type; their values as the bits of doubles, `null` where there is none
("missing", or a number that is not finite); and columns or files that are not read, with their form.
"""

import datetime
import decimal
import json
import random
import struct
import sys
from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as parquet
import scipy.io
import scipy.sparse

INTEGERS = ["int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"]
FLOATS = ["float16", "float32", "float64"]
TEXTS = [
    "",
    "a,b",
    'a "quoted" b',
    "two\nlines",
    "# no remark",
    "µ and 漢字",
    "1,5",
    "-",
    "nan",
    "sep=;",
    "7",
    "x" * 3000,
]
DAY = 86_400
PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
NOON_2026 = 1_795_348_800


def bits(value):
    """Returns the bits of the nearest double, or `None`."""
    if value is None:
        return None
    double = float(value)
    return struct.pack(">d", double).hex() if np.isfinite(double) else None


def column(name, values, is_time=False, within=0.0):
    """Describes a column that is read; `within` is the largest accepted error of a time, in s."""
    return {"name": name, "values": [bits(value) for value in values], "is_time": is_time, "within": within}


class Draw:
    """Random numbers of one file."""

    def __init__(self, seed):
        self.any, self.numbers = random.Random(seed), np.random.default_rng(seed)
        self.used = 0
        #: Version of a Parquet file; only 2.6 has nanoseconds.
        self.version = self.one(["1.0", "2.4", "2.6", "2.6"])

    def one(self, options):
        return self.any.choice(options)

    def is_so(self, probability):
        return self.any.random() < probability

    def some(self, options, least=1):
        return self.any.sample(options, self.any.randint(least, len(options)))

    def name(self, plain=False):
        """Returns a name that is unique in the file and means nothing to the program."""
        self.used += 1
        styles = (
            ["q{}x", "Arm_{}x", "weight{}x"] if plain else ["q{}", "Arm {}", "é{} µ", 'a "{}"', "b,{}", "C#{}", "[{}]"]
        )
        return self.one(styles).format(chr(97 + self.used % 26) * (1 + self.used // 26))

    def array(self, kind, rows):
        """Returns numbers of a kind, up to its limits."""
        kind = np.dtype(kind)
        way = self.any.randrange(4)
        if kind.kind == "b":
            return self.numbers.integers(0, 2, rows).astype(bool)
        if kind.kind == "f" and way < 2:
            scale = 10.0 ** self.any.randint(-4, 4)
            values = (scale * self.numbers.standard_normal(rows)).astype(kind)
            return np.where(self.numbers.random(rows) < 0.05, kind.type(-0.0), values)
        if way == 0:
            return self.numbers.integers(0, 100, rows).astype(kind)
        if way == 1:
            return np.repeat(self.numbers.integers(0, 100, rows), 9)[:rows].astype(kind)
        # Any bits; in floating-point numbers infinities, no numbers, and the smallest ones too.
        return np.frombuffer(self.numbers.bytes(rows * kind.itemsize), kind.newbyteorder("<")).astype(kind)

    def mask(self, rows):
        """Returns missing rows: none, some, runs, or all of them."""
        way = self.any.randrange(8)
        if way < 4:
            return np.zeros(rows, bool)
        if way < 6:
            return self.numbers.random(rows) < 0.2
        return np.repeat(self.numbers.random(rows) < 0.3, 7)[:rows] if way == 6 else np.ones(rows, bool)


# Parquet, by pyarrow


def arrow_numbers(draw, rows, kinds=(*INTEGERS, *FLOATS, "bool")):
    kind = draw.one(kinds)
    return pa.array(draw.array(kind, rows), mask=draw.mask(rows))


def arrow_times(draw, rows):
    """Returns times, and their units in a second."""
    units = draw.numbers.integers(-(10**6), 10**9, rows)
    mask = draw.mask(rows)
    way = draw.any.randrange(4)
    if way == 0:
        return pa.array((units // DAY).astype("i4"), pa.date32(), mask=mask)
    if way == 1:
        return pa.array(units // DAY * DAY * 1000, pa.date64(), mask=mask)
    unit = draw.one(list(PER_SECOND) if draw.version == "2.6" else ["s", "ms", "us"])
    zone = draw.one([None, "UTC", "Europe/Berlin", "+05:30"])
    stamps = NOON_2026 * PER_SECOND[unit] + units
    return pa.array(stamps, pa.timestamp(unit, zone), mask=mask)


def seconds(values):
    """Returns the seconds since 1970 of an Arrow array of times."""
    kind = values.type
    if pa.types.is_date32(kind):
        return [None if day is None else day * DAY for day in values.cast(pa.int32()).to_pylist()]
    per_second = 1000 if pa.types.is_date64(kind) else PER_SECOND[kind.unit]
    return [None if at is None else Fraction(at, per_second) for at in values.cast(pa.int64()).to_pylist()]


def listed(values, sizes, mask=None, kind=pa.list_):
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    return pa.ListArray.from_arrays(
        pa.array(offsets, pa.int32()), values, mask=None if mask is None else pa.array(mask)
    )


def arrow_others(draw, rows):
    """Returns a column that is not a number, and its form if it is refused."""
    mask = draw.mask(rows)
    whole = draw.numbers.integers(0, 1000, rows)

    def of(values, kind):
        return pa.array([None if gone else value for value, gone in zip(values, mask)], kind)

    texts = [draw.one(TEXTS) for _ in range(rows)]
    sizes = draw.numbers.integers(0, 4, rows)
    some = pa.array(draw.array("float64", int(sizes.sum())))
    words = pa.array([draw.one(TEXTS) for _ in range(int(sizes.sum()))], pa.string())
    two = pa.array(draw.numbers.integers(0, 9, (rows, 2)).tolist(), pa.list_(pa.int16(), 2))
    makers = {
        "text": lambda: of(texts, draw.one([pa.string(), pa.large_string()])),
        "category": lambda: of(texts, pa.string()).dictionary_encode(),
        "decimal": lambda: of(
            [decimal.Decimal(int(value)) / 8 for value in whole], draw.one([pa.decimal128(9, 3), pa.decimal256(40, 3)])
        ),
        "binary": lambda: of(
            [b"\xff\0" + bytes([value % 256]) for value in whole], draw.one([pa.binary(), pa.large_binary()])
        ),
        "fixed binary": lambda: of([bytes([value % 256] * 3) for value in whole], pa.binary(3)),
        "list": lambda: listed(some, sizes),
        "list of texts": lambda: listed(words, sizes),
        "list of lists": lambda: pa.array(
            draw.numbers.integers(0, 9, (rows, 2, 2)).tolist(), pa.list_(pa.list_(pa.int8()))
        ),
        "list of structs": lambda: listed(pa.StructArray.from_arrays([some, words], ["u", "v"]), sizes),
        "map": lambda: of(
            [[(f"k{value % 3}", float(value))] * (value % 3) for value in whole.tolist()],
            pa.map_(pa.string(), pa.float64()),
        ),
        "time of day": lambda: of(
            [datetime.time(value // 60, value % 60) for value in whole.tolist()],
            draw.one([pa.time32("ms"), pa.time64("ns")]),
        ),
        "duration": lambda: of([datetime.timedelta(seconds=value) for value in whole.tolist()], pa.duration("ms")),
        "nothing": lambda: pa.nulls(rows),
        "struct of texts": lambda: pa.StructArray.from_arrays(
            [of(texts, pa.string()), two], ["u", "v"], mask=pa.array(mask)
        ),
        "date": lambda: arrow_times(draw, rows),
    }
    form = draw.one(list(makers))
    refused = {"decimal": "type decimal", "fixed binary": "type binary", "time of day": "type time of day"}
    return makers[form](), refused.get(form)


def write_parquet(draw, path):
    rows = draw.one([3, 20, 400, 3000])
    columns, found = {}, []
    for _ in range(draw.any.randint(1, 4)):
        columns[draw.name()] = ("number", arrow_numbers(draw, rows))
    if draw.is_so(0.3):
        values = arrow_numbers(draw, rows, ["int32", "float64"])
        columns[draw.name()] = ("number", values.dictionary_encode())
    if draw.is_so(0.3):
        inner = pa.StructArray.from_arrays([arrow_numbers(draw, rows)], ["z"], mask=pa.array(draw.mask(rows)))
        fields = [arrow_numbers(draw, rows), arrow_others(draw, rows)[0], inner]
        outer = pa.StructArray.from_arrays(fields, ["x", "note", "in"], mask=pa.array(draw.mask(rows)))
        columns[draw.name()] = ("struct", outer)
    if draw.is_so(0.3):
        length = draw.any.randint(1, 5)
        elements = arrow_numbers(draw, rows * length)
        mask = draw.mask(rows) if draw.is_so(0.5) else None
        if draw.is_so(0.5):
            mask = None if mask is None else pa.array(mask)
            lists = pa.FixedSizeListArray.from_arrays(elements, length, mask=mask)
        else:
            lists = listed(elements, np.full(rows, length), mask)
        columns[draw.name()] = ("list", lists)
    for _ in range(draw.any.randint(0, 2)):
        columns[draw.name()] = ("time", arrow_times(draw, rows))
    refused = []
    for _ in range(draw.any.randint(0, 5)):
        name = draw.name()
        values, form = arrow_others(draw, rows)
        columns[name] = ("other", values)
        if form and rows > values.null_count:
            refused.append({"name": name, "form": form})
    order = draw.some(list(columns), len(columns))
    table = pa.table({name: columns[name][1] for name in order})
    encodings, dictionary = {}, []
    for name in order:
        kind = table.schema.field(name).type
        options = [None]
        if pa.types.is_integer(kind):
            options += ["PLAIN", "DELTA_BINARY_PACKED"]
        elif pa.types.is_string(kind):
            options += ["PLAIN", "DELTA_LENGTH_BYTE_ARRAY", "DELTA_BYTE_ARRAY"]
        elif kind in (pa.float16(), pa.float32(), pa.float64(), pa.int32(), pa.int64()):
            options += ["PLAIN", "BYTE_STREAM_SPLIT"]
        elif pa.types.is_boolean(kind):
            options += ["PLAIN", "RLE"]
        encoding = draw.one(options)
        if encoding is not None:
            encodings[name] = encoding
        elif not pa.types.is_nested(kind) and draw.is_so(0.7):
            dictionary.append(name)
    codecs = ["none", "snappy", "gzip", "zstd", "lz4"]
    compression = draw.one(codecs)
    if draw.is_so(0.1):
        # A codec for each column. Brotli in an unwanted column does not make the file unreadable.
        compression = {
            name: draw.one(codecs) for name in order if not pa.types.is_nested(table.schema.field(name).type)
        }
        flat = [
            name for name in compression if columns[name][0] == "other" and name not in [it["name"] for it in refused]
        ]
        if flat:
            compression[flat[0]] = "brotli"
            refused.append({"name": flat[0], "form": "compressed with Brotli"})
    small = rows <= 400
    parquet.write_table(
        table,
        path,
        compression=compression,
        use_dictionary=dictionary,
        column_encoding=encodings or None,
        version=draw.version,
        data_page_version=draw.one(["1.0", "2.0"]),
        data_page_size=draw.one([None, 256, 4096]),
        max_rows_per_page=draw.one([None, 7 if small else 500]),
        dictionary_pagesize_limit=draw.one([None, 200]),
        row_group_size=draw.one([None, 1 if rows < 50 else 50, 64]) if small else draw.one([None, 700]),
        write_page_checksum=draw.is_so(0.3),
        write_page_index=draw.is_so(0.3),
        write_statistics=draw.is_so(0.5),
        store_schema=draw.is_so(0.5),
        store_decimal_as_integer=draw.is_so(0.3),
        use_deprecated_int96_timestamps=draw.is_so(0.1),
    )
    table = parquet.read_table(path)
    for name in order:
        how, values = columns[name][0], table.column(name).combine_chunks()
        if how == "number":
            found.append(column(name, values.to_pylist()))
        elif how == "time":
            found.append(column(name, seconds(values), True))
        elif how == "struct":
            records = values.to_pylist()
            for path_of in (["x"], ["in", "z"]):
                inner = records
                for field in path_of:
                    inner = [None if record is None else record[field] for record in inner]
                found.append(column(".".join([name, *path_of]), inner))
        elif how == "list" and values.null_count < rows:
            lists = values.to_pylist()
            found += [
                column(f"{name}{at + 1}", [None if of is None else of[at] for of in lists]) for at in range(length)
            ]
    return {"columns": found, "refused": refused, "first_line": 2}


# .npy, by NumPy


def numpy_kind(draw, kinds=(*INTEGERS, *FLOATS)):
    return np.dtype(draw.one(kinds)).newbyteorder(draw.one("<>"))


def of_numpy(name, values):
    """Describes a column of numbers or times that NumPy reads."""
    if values.dtype.kind != "M":
        return column(name, values.tolist())
    unit, count = np.datetime_data(values.dtype)
    step = Fraction(count) * {"W": 7 * DAY, "D": DAY, "h": 3600, "m": 60, "ps": Fraction(1, 10**12)}.get(
        unit, Fraction(1, PER_SECOND.get(unit, 1))
    )
    is_gone = np.isnat(values)
    return column(name, [None if gone else at * step for at, gone in zip(values.astype("i8").tolist(), is_gone)], True)


def numpy_others(draw, rows):
    """Returns a field that is not a number: its type, and its form if it is refused."""
    return draw.one(
        [
            ("S7", None),
            ("U5", None),
            (">U3", None),
            ("c16", "type `<c16`"),
            ("V5", "type `|V5`"),
            ("m8[ms]", "type `<m8[ms]`"),
            ("g", "type `<f16`"),
            ("M8[Y]", "type `<M8[Y]`"),
            ([("u", "c8"), ("v", "S3")], None),
        ]
    )


def write_npy(draw, path):
    rows = draw.one([3, 20, 400, 3000])
    way = draw.any.randrange(8)
    first_line, refused, named = 1, [], {}
    if way < 3:
        width = draw.any.randint(1, 9)
        kind = numpy_kind(draw, (*INTEGERS, *FLOATS, "bool"))
        array = draw.array(kind, rows * width).astype(kind)
        array = array if way == 0 and width == 1 else array.reshape(rows, width, order="F")
        if draw.is_so(0.5):
            array = np.asfortranarray(array)
        wanted = [(str(at + 1), at) for at in range(width)]
    elif way == 3:
        # Arrays that are no table.
        array, form = draw.one(
            [
                (np.zeros((rows, 2, 3)), ", expected one of rows and columns"),
                (np.array([1, "x", None] * rows, dtype=object), "type `|O`"),
                (np.zeros(rows, "c16"), "type `<c16`"),
                (np.zeros((rows, 2), "m8[ms]"), "type `<m8[ms]`"),
                (np.float64(1.5), ", expected one of rows and columns"),
            ]
        )
        np.save(path, array, allow_pickle=True)
        return {"columns": [], "refused": [{"name": "", "form": form}], "first_line": 1}
    else:
        first_line, fields, wanted = 2, [], []
        for _ in range(draw.any.randint(1, 4)):
            fields.append((draw.name(), numpy_kind(draw, (*INTEGERS, *FLOATS, "bool"))))
            wanted.append((fields[-1][0], (fields[-1][0],)))
        if draw.is_so(0.5):
            name, sides = draw.name(), draw.one([(3,), (2, 3)])
            fields.append((name, numpy_kind(draw), sides))
            places = list(np.ndindex(sides))
            wanted += [(f"{name}{at + 1}", (name, place)) for at, place in enumerate(places)]
        if draw.is_so(0.5):
            name = draw.name()
            inner = [("x", numpy_kind(draw)), ("note", "S4"), ("in", [("z", numpy_kind(draw)), ("w", "c8")])]
            fields.append((name, np.dtype(inner, align=draw.is_so(0.5))))
            wanted += [(f"{name}.x", (name, "x")), (f"{name}.in.z", (name, "in", "z"))]
        if draw.is_so(0.5):
            units = ["s", "ms", "us", "ns", "D", "h", "m", "W", "ps", "25ms", "10us"]
            fields.append((draw.name(), draw.one("<>") + f"M8[{draw.one(units)}]"))
            wanted.append((fields[-1][0], (fields[-1][0],)))
        for _ in range(draw.any.randint(0, 4)):
            kind, form = numpy_others(draw, rows)
            fields.append((draw.name(), kind))
            if form:
                refused.append({"name": fields[-1][0], "form": form})
        draw.any.shuffle(fields)
        array = np.zeros(rows, np.dtype(fields, align=draw.is_so(0.3)))

        def fill(target):
            for name in target.dtype.names:
                kind = target.dtype[name]
                if kind.names:
                    fill(target[name])
                elif kind.base.kind in "iufb":
                    count = rows * int(np.prod(kind.shape))
                    target[name] = draw.array(kind.base, count).reshape((rows, *kind.shape))
                elif kind.kind == "M":
                    stamps = draw.numbers.integers(-1000, 10**6, rows).astype("i8")
                    target[name] = stamps.view("M8" + kind.str[3:])
                    target[name][draw.mask(rows)] = "NaT"
                elif kind.kind in "SU":
                    target[name] = [
                        text.encode("ascii", "ignore") if kind.kind == "S" else text
                        for text in draw.any.choices(TEXTS, k=rows)
                    ]

        fill(array)
    with open(path, "wb") as file:
        np.lib.format.write_array(file, array, version=draw.one([None, None, (2, 0), (3, 0)]))
    array, found = np.load(path), []
    for name, place in wanted:
        if isinstance(place, int):
            values = array if array.ndim == 1 else array[:, place]
        else:
            values = array
            for step in place:
                values = values[(slice(None), *step)] if isinstance(step, tuple) else values[step]
        found.append(of_numpy(name, values))
        found[-1]["at"] = None if first_line == 2 else int(name)
    draw.any.shuffle(found)
    return {"columns": found, "refused": refused, "first_line": first_line}


# MATLAB 5 and 7.3, by SciPy and h5py


def write_matlab(draw, path):
    rows = draw.one([13, 60, 400, 2000])
    if draw.is_so(0.05):
        scipy.io.savemat(path, {"x": np.arange(rows)}, format="4")
        return {"columns": [], "refused": [{"name": "", "form": "a MATLAB 4 file"}], "first_line": 1}
    kinds = [*INTEGERS, "float32", "float64", "bool"]
    variables, wanted = {}, []

    def vector():
        return draw.array(draw.one(kinds), rows)

    for _ in range(draw.any.randint(1, 4)):
        name = draw.name(plain=True)
        variables[name] = vector()
        wanted.append((name, (name,), None))
    if draw.is_so(0.5):
        name, width = draw.name(plain=True), draw.any.randint(2, 8)
        variables[name] = draw.array(draw.one(kinds), rows * width).reshape(rows, width)
        wanted += [(f"{name}{at + 1}", (name,), at) for at in range(width)]
    if draw.is_so(0.5):
        name, one, two = draw.name(plain=True), draw.name(plain=True), draw.name(plain=True)
        variables[name] = {
            one: vector(),
            "words": np.array(draw.any.choices(TEXTS[:5], k=rows), object),
            "in": {two: vector()},
        }
        wanted += [(one, (name, one), None), (two, (name, "in", two), None)]
    others = {
        "complex numbers": lambda: draw.numbers.standard_normal(rows) + 1j,
        "no numbers and no texts": lambda: scipy.sparse.csc_array(np.eye(rows, 3)),
        "an array of structs": lambda: np.zeros(rows, [("u", "f8"), ("v", "i4")]),
        "cells that are not texts": lambda: np.array([np.arange(3), "x", 2.5] * 3, object),
        "more than two sides": lambda: np.zeros((2, 2, 2)),
        None: lambda: draw.one(
            ["a remark", 7.5, np.zeros(0), np.array(draw.any.choices(TEXTS, k=rows), object), np.array(["ab"] * rows)]
        ),
    }
    refused = []
    for form in draw.some(list(others), 0):
        name = draw.name(plain=True)
        variables[name] = others[form]()
        if form:
            refused.append({"name": name, "form": form})
    order = draw.some(list(variables), len(variables))
    scipy.io.savemat(
        path,
        {name: variables[name] for name in order},
        do_compression=draw.is_so(0.5),
        oned_as=draw.one(["row", "column"]),
        long_field_names=draw.is_so(0.5),
    )
    read, found = scipy.io.loadmat(path), []
    for name, place, at in wanted:
        values = read[place[0]]
        for field in place[1:]:
            values = values[0, 0][field]
        found.append(column(name, (values.ravel() if at is None else values[:, at]).tolist()))
    draw.any.shuffle(found)
    return {"columns": found, "refused": refused, "first_line": 2}


def write_matlab_73(draw, path):
    rows = draw.one([13, 60, 400])
    wanted = []
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(name, values, of=None):
            # MATLAB stores matrices column by column.
            stored = file.create_dataset(name, data=np.atleast_2d(values.T), compression=draw.one([None, "gzip"]))
            usual = {"float64": "double", "float32": "single", "bool": "logical"}
            stored.attrs["MATLAB_class"] = np.bytes_(of or usual.get(values.dtype.name, values.dtype.name))

        for _ in range(draw.any.randint(1, 4)):
            name, kind = draw.name(plain=True), draw.one([*INTEGERS, "float32", "float64"])
            put(draw.one(["", "run/"]) + name, draw.array(kind, rows))
            wanted.append((name, None))
        if draw.is_so(0.5):
            name, width = draw.name(plain=True), draw.any.randint(2, 8)
            put(name, draw.array("float64", rows * width).reshape(rows, width))
            wanted += [(f"{name}{at + 1}", at) for at in range(width)]
        put("zz_note", np.arange(rows, dtype="u2"), "char")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\x02IM")
    found = []
    with h5py.File(path) as file:
        for name, at in wanted:
            whole = name if at is None else name.rstrip("0123456789")
            values = file[whole if whole in file else f"run/{whole}"][()]
            found.append(column(name, values[0 if at is None else at].tolist()))
    draw.any.shuffle(found)
    return {"columns": found, "refused": [{"name": "zz_note", "form": "no numbers"}], "first_line": 2}


# HDF5, by h5py


def write_hdf5(draw, path):
    rows = draw.one([13, 60, 400, 3000])
    wanted, refused = [], []
    with h5py.File(
        path,
        "w",
        libver=draw.one(["earliest", ("v108", "v114"), ("v110", "v114"), ("v112", "v114")]),
        track_order=draw.is_so(0.2),
    ) as file:

        def options(shape, kind):
            way = draw.any.randrange(4)
            if way == 0:
                return {}
            chunk = tuple(draw.any.randint(1, side) for side in shape)
            chunk = (max(chunk[0], rows // 40 + 1), *chunk[1:])
            chosen = {"chunks": draw.one([True, chunk]), "shuffle": draw.is_so(0.3), "fletcher32": draw.is_so(0.3)}
            chosen["compression"] = draw.one([None, "gzip", "lzf"])
            if draw.is_so(0.2):
                chosen["maxshape"] = (None, *shape[1:])
            if np.dtype(kind).kind in "iu" and np.dtype(kind).isnative and draw.is_so(0.1):
                chosen |= {"scaleoffset": 0, "fletcher32": False, "shuffle": False}
            return chosen

        def at(name):
            return draw.one(["", "", "run/", "run/deep/"]) + name

        def put(name, values, **more):
            path_of = at(name)
            file.create_dataset(path_of, data=values, **(options(values.shape, values.dtype) | more))
            return path_of

        kinds = [*INTEGERS, *FLOATS, "bool"]
        makers = []

        def vector():
            name, kind = draw.name(plain=True), draw.one(kinds)
            kind = np.dtype(kind) if kind == "bool" else np.dtype(kind).newbyteorder(draw.one("<>"))
            wanted.append((name, put(name, draw.array(kind, rows).astype(kind)), None, 1))

        def matrix():
            name, width = draw.name(plain=True), draw.any.randint(2, 8)
            kind = np.dtype(draw.one(kinds[:-1]))
            where = put(name, draw.array(kind, rows * width).reshape(rows, width))
            wanted.extend((f"{name}{at + 1}", where, at, 1) for at in range(width))

        def enumeration():
            name = draw.name(plain=True)
            kind = h5py.enum_dtype({"idle": 0, "moving": 7}, basetype="i2")
            where = put(name, (draw.numbers.integers(0, 2, rows) * 7).astype(kind), scaleoffset=None)
            wanted.append((name, where, None, 1))

        def unwritten():
            name = draw.name(plain=True)
            where = at(name)
            made = file.create_dataset(
                where, (rows,), draw.one(["f8", "i4"]), fillvalue=draw.one([None, -3]), chunks=(rows // 3,)
            )
            made[: rows // 2] = draw.numbers.integers(0, 100, rows // 2)
            wanted.append((name, where, None, 1))

        def time():
            # Milliseconds as pandas and xarray write them, with the unit in an attribute.
            name, unit = draw.name(plain=True), draw.one(["ms", "us", "milliseconds since 2026-03-01 12:00:00", "s"])
            where = put(
                name, np.cumsum(draw.numbers.integers(1, 50, rows)).astype(draw.one(["i8", "f8"])), shuffle=False
            )
            file[where].attrs["units"] = unit
            wanted.append((name, where, None, {"ms": 1000, "us": 10**6, "s": 1}.get(unit, 1000)))

        def refuse(form, make):
            def put_it():
                name = draw.name(plain=True)
                where = at(name)
                make(where)
                if form:
                    refused.append({"name": name, "form": form})

            return put_it

        texts = draw.any.choices([text for text in TEXTS if text], k=rows)
        record = np.zeros(rows, [("u", "f8"), ("v", "i2", (3,)), ("w", "S3")])
        everything = [
            refuse("records of several fields", lambda where: file.create_dataset(where, data=record)),
            refuse("more than two sides", lambda where: file.create_dataset(where, data=np.zeros((2, 2, 2)))),
            refuse("records of several fields", lambda where: file.create_dataset(where, data=np.zeros(rows, "c16"))),
            refuse("values of an unusual type", lambda where: file.create_dataset(where, data=np.zeros(rows, "V4"))),
            refuse(
                "values of an unusual type", lambda where: file.create_dataset(where, (rows,), h5py.vlen_dtype("f4"))
            ),
            refuse(
                "values of an unusual type", lambda where: file.create_dataset(where, (rows,), np.dtype(("f4", (2,))))
            ),
            refuse("references", lambda where: file.create_dataset(where, (rows,), h5py.ref_dtype)),
            refuse("values of an unusual type", lambda where: file.create_dataset(where, data=np.zeros(rows, "g"))),
            refuse(None, lambda where: file.create_dataset(where, data=texts)),
            refuse(None, lambda where: file.create_dataset(where, data=np.array([b"ab", b"c"] * rows, "S5")[:rows])),
            refuse(None, lambda where: file.create_dataset(where, data="made by hand")),
            refuse(None, lambda where: file.create_dataset(where, data=7.5)),
            refuse(None, lambda where: file.create_dataset(where, data=h5py.Empty("f4"))),
            refuse(None, lambda where: file.create_dataset(where, (0,), "f8", maxshape=(None,))),
            refuse(None, lambda where: file.__setitem__(where, h5py.SoftLink("/nowhere"))),
            refuse(None, lambda where: file.__setitem__(where, h5py.ExternalLink("other.h5", "/x"))),
            refuse(None, lambda where: file.__setitem__(where, np.dtype([("a", "i4")]))),
            refuse(None, lambda where: file.create_group(where)),
            refuse(
                "compressed with scale-offset",
                lambda where: file.create_dataset(
                    where, data=np.arange(rows, dtype=draw.one(["<i4", ">i4"])), scaleoffset=0, shuffle=True
                ),
            ),
            refuse(
                "compressed with scale-offset",
                lambda where: file.create_dataset(where, data=np.arange(rows, dtype=">i8"), scaleoffset=0),
            ),
        ]
        makers = [vector, *draw.any.choices([vector, matrix, enumeration, unwritten, time], k=draw.any.randint(0, 4))]
        makers += draw.some(everything, 0)[:5]
        draw.any.shuffle(makers)
        for make in makers:
            make()
        file.attrs["rig"] = 7
    found = []
    with h5py.File(path) as file:
        for name, where, at_column, per_second in wanted:
            values = file[where][()]
            values = (values if at_column is None else values[:, at_column]).tolist()
            if per_second == 1:
                found.append(column(name, values))
            else:
                found.append(column(name, [Fraction(value) / per_second for value in values], True))
    draw.any.shuffle(found)
    return {"columns": found, "refused": refused, "first_line": 2}


# Excel, by openpyxl


def write_xlsx(draw, path):
    rows = draw.one([5, 30, 120])
    book = openpyxl.Workbook(write_only=draw.is_so(0.3), iso_dates=draw.is_so(0.1))
    if draw.is_so(0.3):
        book.epoch = openpyxl.utils.datetime.CALENDAR_MAC_1904
    sheet = book.create_sheet("run") if book.write_only else book.active
    columns = {}

    def cells(values):
        mask = draw.mask(rows) if draw.is_so(0.5) else np.zeros(rows, bool)
        return [None if gone else value for value, gone in zip(values, mask)]

    start = datetime.datetime(2026, 11, 22, 10)

    def moments(step):
        return [start + datetime.timedelta(milliseconds=int(at)) for at in step]

    steps = np.cumsum(draw.numbers.integers(1, 10**5, rows))
    for _ in range(draw.any.randint(2, 5)):
        kind = draw.one([*INTEGERS, "float32", "float64", "float64"])
        values = draw.array(kind, rows)
        # openpyxl reads -0 as an integer.
        values = np.where(np.isfinite(values) & (values != 0), values, 0).astype(kind)
        columns[draw.name()] = ("number", cells(values.tolist()))
    if draw.is_so(0.6):
        way = draw.any.randrange(3)
        if way == 0:
            values = moments(steps)
        elif way == 1:
            values = [datetime.timedelta(milliseconds=int(at)) for at in steps]
        else:
            values = [(datetime.datetime(1, 1, 1) + datetime.timedelta(milliseconds=int(at))).time() for at in steps]
        columns[draw.name()] = ("time", cells(values))
    others = [
        # A row is a remark if its first text begins with `#`.
        lambda: [draw.one([text for text in TEXTS if text[:1] != "#"]) or None for _ in range(rows)],
        lambda: [at % 2 == 0 for at in range(rows)],
        lambda: moments(steps),
        lambda: [at.date() for at in moments(steps)],
        lambda: ["=1+1"] * rows,
        lambda: ["#DIV/0!"] * rows,
        lambda: [None] * rows,
    ]
    for make in draw.some(others, 0)[:4]:
        columns[draw.name()] = ("other", cells(make()))
    order = draw.some(list(columns), len(columns))
    above = 0
    if draw.is_so(0.2):
        sheet.append(["recorded on a Sunday"])
        above = 1
    sheet.append(order)
    for row in range(rows):
        sheet.append([columns[name][1][row] for name in order])
    if draw.is_so(0.3):
        book.create_sheet("notes").append(["rig", 7])
    book.save(path)
    book = openpyxl.load_workbook(path, data_only=True)
    sheet, found = book["run" if "run" in book.sheetnames else "Sheet"], []
    read = [[cell.value for cell in row] for row in sheet.iter_rows(min_row=above + 2, max_row=above + rows + 1)]

    def in_seconds(value):
        if isinstance(value, datetime.time):
            value = datetime.datetime.combine(datetime.date(1, 1, 1), value) - datetime.datetime(1, 1, 1)
        if isinstance(value, datetime.datetime):
            value = value - datetime.datetime(1970, 1, 1)
        return None if value is None else Fraction(value // datetime.timedelta(microseconds=1), 10**6)

    for at, name in enumerate(order):
        values = [row[at] if at < len(row) else None for row in read]
        if columns[name][0] == "number":
            found.append(column(name, values))
        elif columns[name][0] == "time" and any(value is not None for value in values):
            # Days of 2026 as doubles have steps of 0.63 µs, and openpyxl writes 16 digits of them, 0.86 µs apart; the
            # program rounds to 1 µs, and seconds since 1970 as doubles have steps of 0.24 µs.
            found.append(column(name, [in_seconds(value) for value in values], True, 1.25e-6))
    draw.any.shuffle(found)
    return {"columns": found, "refused": [], "first_line": above + 2, "first_row": above + 2}


def write_foreign(draw, path):
    """Writes an array archive or an Arrow file, which are refused."""
    way = draw.any.randrange(4)
    table = pa.table({"x": np.arange(20.0)})
    if way == 0:
        np.savez(path, a=np.zeros((20, 2)))
        path.with_suffix(path.suffix + ".npz").rename(path)
        form = "an archive of NumPy arrays"
    elif way == 1:
        feather.write_feather(table, path)
        form = "an Arrow or Feather file"
    else:
        opener = pa.ipc.new_file if way == 2 else pa.ipc.new_stream
        with opener(path, table.schema) as writer:
            writer.write_table(table)
        form = "an Arrow or Feather file"
    return {"columns": [], "refused": [{"name": "", "form": form}], "first_line": 1}


KINDS = [
    ("parquet", write_parquet),
    ("npy", write_npy),
    ("mat", write_matlab),
    ("h5", write_hdf5),
    ("xlsx", write_xlsx),
    ("parquet", write_parquet),
    ("npy", write_npy),
    ("mat", write_matlab_73),
    ("h5", write_hdf5),
    ("bin", write_foreign),
]


def main():
    folder, first, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    for number in range(first, first + count):
        extension, write = KINDS[number % len(KINDS)]
        path = folder / f"{number}.{extension}"
        described = write(Draw(number), path)
        print(json.dumps({"file": path.name, "first_row": 1, **described}))


main()

#!/usr/bin/env bash
# Question: packets of a Net F/T box are integers in network byte order; np.frombuffer(packet, ">i4") reads them. May
# such an array go to npTDMS as it is?
# Good guess: yes, as into HDF5 (h5py, PyTables), netCDF and MF4 (asammdf): a writer looks at the order, or refuses.
# True: TdmsWriter takes the type for a little-endian integer and writes the bytes as they lie: 1000 counts come back as
# -402456576, without a warning. data.astype("=i4") first is right.
# Package: npTDMS 1.13.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check npTDMS==1.13.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from nptdms import ChannelObject, TdmsFile, TdmsWriter

packet = bytes.fromhex("000003e8 ffffb1e0 00000003")
counts = np.frombuffer(packet, ">i4")


def written(data):
    with TdmsWriter("log.tdms") as writer:
        writer.write_segment([ChannelObject("sensor", "fz", data)])
    return TdmsFile.read("log.tdms")["sensor"]["fz"][:]


print("counts of the packet:      ", counts)
print("from the file, as read:    ", written(counts))
print("from the file, native order:", written(counts.astype("=i4")))
assert counts.tolist() == [1000, -20000, 3]
assert written(counts).tolist() == counts.byteswap().view("<i4").byteswap().view(">i4").view("<i4").tolist()
assert written(counts)[0] == -402456576
assert written(counts.astype("=i4")).tolist() == counts.tolist()
PYTHON

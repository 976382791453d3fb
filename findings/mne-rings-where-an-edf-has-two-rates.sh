#!/usr/bin/env bash
# Question: an EDF file with a force at 1000 Hz and a reference at 100 Hz, read by MNE: what is the reference between
# its samples?
# Good guess: held, interpolated or left apart; at any rate never outside the range of the samples.
# True: MNE has one rate for all channels, brings the slower one up by its Fourier series, and takes it for periodic: a
# load put on, 0 to 50 N, reads down to -7.0 and up to 57 N, rings for tenths of a second, and begins and ends wrong, too.
# Nothing is warned of.
# Packages: MNE 1.13.2, pyEDFlib 0.1.42.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mne==1.13.2 pyEDFlib==0.1.42 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import mne
import numpy as np
import pyedflib

writer = pyedflib.EdfWriter("log.edf", 2, file_type=pyedflib.FILETYPE_EDFPLUS)
for channel, (label, rate) in enumerate((("Fz", 1000), ("reference", 100))):
    writer.setSignalHeader(channel, dict(
        label=label, dimension="N", sample_frequency=rate, physical_min=-100, physical_max=100,
        digital_min=-32768, digital_max=32767, transducer="", prefilter=""))
writer.writeSamples([np.repeat([0.0, 50.0], 5000), np.repeat([0.0, 50.0], 500)])
writer.close()

raw = mne.io.read_raw_edf("log.edf", preload=True, verbose="WARNING")
force, reference = raw.get_data()
print(f"rate {raw.info['sfreq']:g} Hz; force {force.min():.2f} to {force.max():.2f} N;",
      f"reference {reference.min():.2f} to {reference.max():.2f} N")
print("reference from 10 ms before the load:", reference[4990:5010:2].round(2))
assert reference.shape == (10000,)
assert -0.01 < force.min() and force.max() < 50.01
assert reference.min() < -5 and reference.max() > 55
PYTHON

#!/usr/bin/env bash
# Question: forces beside EMG are exported from MNE to EDF as channels of type "misc". How finely are they stored?
# Good guess: EDF has 16 bits and a physical range for each channel, so each is good to 1.5e-5 of its own range.
# True: with physical_range="auto" all channels of a type share one range. A moment of +-0.01 N m beside a force of
# +-100 N is stored in steps of 3 mN m: 7 values are left of it. And all of them come back as EEG, since EDF knows no
# types. physical_range="channelwise" gives each its own.
# Packages: MNE 1.13.2, edfio 0.4.18.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mne==1.13.2 edfio==0.4.18 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import mne
import numpy as np

mne.set_log_level("ERROR")
t = np.arange(5000) / 1000
wrench = np.array([100 * np.sin(t), 0.01 * np.sin(3 * t)])
raw = mne.io.RawArray(wrench, mne.create_info(["Fz", "Mz"], 1000, "misc"))
left = {}
for choice in ("auto", "channelwise"):
    mne.export.export_raw("log.edf", raw, overwrite=True, physical_range=choice)
    back = mne.io.read_raw_edf("log.edf", preload=True)
    moment = back.get_data()[1]
    left[choice] = len(np.unique(moment)), abs(moment - wrench[1]).max()
    print(f'physical_range="{choice}": {left[choice][0]} values of the moment, off by up to {left[choice][1]:.2g} N m;',
          "types", back.get_channel_types())
assert left["auto"][0] <= 8 and left["auto"][1] > 0.001
assert left["channelwise"][0] > 1000 and left["channelwise"][1] < 1e-6
assert set(back.get_channel_types()) == {"eeg"}
PYTHON

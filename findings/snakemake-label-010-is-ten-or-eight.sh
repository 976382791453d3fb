#!/usr/bin/env bash
# Question: a workflow takes the label of a trial from its configuration: `snakemake --config trial=010`, or `trial: 010` in
# the file of `--configfile`. Which trial is it? And the serial number 12E4, the time 12:30?
# Good guess: labels stay as they were typed, or at least both ways agree.
# True: on the command line 010 is the number 10, in the file it is 8 (octal, YAML 1.1), although 08 in the file stays "08".
# 12E4 is 120000.0 on the command line and "12E4" in the file; 12:30 is "12:30" on the command line and 750 in the file. A
# rule with "runs/{config[trial]}.csv" reads runs/10.csv or runs/8.csv. Quotes keep the text in the file.
# Package: snakemake 9.27.1.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check snakemake==9.27.1
cd "$folder"
cat >Snakefile <<'PYTHON'
import json

rule all:
    run:
        with open("found.json", "w") as file:
            json.dump(config, file, sort_keys=True)
PYTHON
cat >labels.yaml <<'YAML'
trial: 010
pose: 08
serial: 12E4
start: 12:30
quoted: "010"
YAML
run() {
    venv/bin/snakemake --cores 1 --quiet all "$@" >run.log 2>&1 || { cat run.log; exit 1; }
    cat found.json
    echo
}
run --config trial=010 pose=08 serial=12E4 start=12:30 >typed
run --configfile labels.yaml >filed
cat typed filed
[ "$(cat typed)" = '{"pose": 8, "serial": 120000.0, "start": "12:30", "trial": 10}' ]
[ "$(cat filed)" = '{"pose": "08", "quoted": "010", "serial": "12E4", "start": 750, "trial": 8}' ]

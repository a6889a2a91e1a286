#!/bin/sh
# Checks that readers of other projects decode our recordings: writes one with messages of every
# topic and compares what the readers on PyPI decode with what was written. Needs python3 with venv,
# and the network for the first run.
# usage: .ci/readers/run.sh [WORK_DIRECTORY]   (kept when given; else made and removed)
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
if [ $# -gt 0 ]; then
    work=$1
    mkdir -p "$work"
else
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
fi
if [ ! -x "$work/venv/bin/python" ]; then
    python3 -m venv "$work/venv"
fi
"$work/venv/bin/pip" install --quiet --disable-pip-version-check -r "$here/requirements.txt"
rm -f "$work/check.mcap" "$work/check.jsonl"
(cd "$root" && cargo run --quiet -p recording --example reader_check -- \
    "$work/check.mcap" "$work/check.jsonl")
"$work/venv/bin/python" "$here/check.py" "$work/check.mcap" "$work/check.jsonl"

#!/bin/sh
# Other system-identification programs on the same data: PySINDy and SysIdentPy, from PyPI, beside
# `farreach identify`. A benchmark of about an hour on one core, not part of CI. Needs python3 with
# venv, and the network for the first run.
# usage: tests/other_identifiers/run.sh WORK_DIRECTORY FARREACH AHEAD CASES DATA [CASE...]
#   WORK_DIRECTORY  is kept: venv, results of each case (a second run continues), peers.json and .md
#   FARREACH        the program, built in release:  cargo build --release
#   AHEAD           predicts with the fitted model:
#                   cargo build --release -p identify --example prediction_horizon
#   CASES           folder of blind cases:
#                   cargo run --release -p blind_cases --bin generate -- --help
#   DATA            folder with emps_train.csv and silverbox_multisine.csv; absent ones are skipped
#                   with a message
#   CASE            names of cases in that folder, emps, silverbox; default: those of
#                   docs/identify-peers.md
set -eu
here=$(cd "$(dirname "$0")" && pwd)
if [ $# -lt 5 ]; then
    sed -n '/^# usage/,/^set/{/^set/d;s/^# \{0,1\}//;p;}' "$0" >&2
    exit 2
fi
work=$1
shift
. "$here/venv.sh"
exec "$work/venv/bin/python" "$here/bench.py" --work "$work" --farreach "$1" \
    --ahead "$2" --cases "$3" --data "$4" --revision \
    "$(git -C "$here" describe --always --dirty --exclude='*' 2>/dev/null || echo unknown)" \
    $(shift 4; for name in "$@"; do printf -- '--case %s ' "$name"; done)

#!/bin/sh
# Writes the table of docs/identify-measured.md again: `farreach identify`, a hand fit, PySINDy and
# SysIdentPy on the records that others measured. Some minutes on one core, not part of CI. Needs
# python3 (3.11 or newer) with venv, and the network for the first run.
# usage: tests/other_identifiers/run_measured.sh WORK_DIRECTORY FARREACH DATA [SET...]
#   WORK_DIRECTORY  is kept: venv, and farreach's JSON output of each set
#   FARREACH        the program, built in release:  cargo build --release
#   DATA            ../shared/data: measured/, emps_train.csv and silverbox_multisine.csv
#   SET             these alone, printed and not written to the page
set -eu
here=$(cd "$(dirname "$0")" && pwd)
if [ $# -lt 3 ]; then
    sed -n '/^# usage/,/^set/{/^set/d;s/^# \{0,1\}//;p;}' "$0" >&2
    exit 2
fi
work=$1 farreach=$2 data=$3
shift 3
. "$here/venv.sh"
exec "$work/venv/bin/python" "$here/measured.py" --work "$work" --farreach "$farreach" \
    --data "$data" --page "$here/../../docs/identify-measured.md" --revision \
    "$("$farreach" --version | sed 's/.*revision //')" \
    $(for name in "$@"; do printf -- '--set %s ' "$name"; done)

#!/bin/sh
# Fuzzes every parser of what a user, a file or another process gives (tests/fuzz_targets), one
# after another, and prints a line for each: cases, code covered, longest case, findings.
#
# usage: tests/fuzz/run.sh [CASES [TARGET...]]   (default: 1000000 cases of every target)
#
# Needs a C++ compiler, a nightly toolchain, and cargo-fuzz (`cargo install cargo-fuzz --locked`).
# A case may take 10 s and the fuzzer 1 GiB; beyond that, and at a panic, the input is kept in
# tests/fuzz/artifacts/TARGET. To see what it does:
#
#     cargo +nightly fuzz run --fuzz-dir tests/fuzz --sanitizer none TARGET INPUT
set -eu
cd "$(dirname "$0")/../.."
cases=${1:-1000000}
[ $# -eq 0 ] || shift
folder=tests/fuzz
# the versions of the workspace; cargo adds the fuzzer's own
cp Cargo.lock $folder/Cargo.lock
[ $# -gt 0 ] || set -- $(sed -n '/^\[\[bin/,$s/^name = "\(.*\)"/\1/p' $folder/Cargo.toml)
cargo +nightly fuzz build --fuzz-dir $folder --sanitizer none
mkdir -p $folder/logs
failed=0
printf '%-18s %9s %7s %9s %7s %12s  %s\n' target cases edges features corpus 'longest ms' findings
for target; do
    log=$folder/logs/$target.log
    mkdir -p $folder/corpus/$target
    # bit 2 of the mask: what the parsers write to standard error
    cargo +nightly fuzz run --fuzz-dir $folder --sanitizer none "$target" -- -runs="$cases" \
        -seed=1 -timeout=10 -rss_limit_mb=1024 -max_len=65536 -len_control=0 \
        -print_final_stats=1 -close_fd_mask=2 >"$log" 2>&1 || failed=1
    done_cases=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    figures=$(sed -n 's/.* cov: \([0-9]*\) ft: \([0-9]*\) corp: \([0-9]*\).*/\1 \2 \3/p' "$log" |
        tail -n 1)
    longest=$(sed -n 's/^longest case so far: \([0-9]*\) us.*/\1/p' "$log" | tail -n 1)
    found=$(grep -c '^SUMMARY: libFuzzer' "$log" || true)
    # shellcheck disable=SC2086
    printf '%-18s %9s %7s %9s %7s %12s  %s\n' "$target" "${done_cases:-0}" ${figures:-0 0 0} \
        "$(echo "${longest:-0}" | awk '{ printf "%.1f", $1 / 1000 }')" "$found"
done
exit $failed

#!/usr/bin/env bash
# Builds the Debian package: the program, its man pages and completions, which it prints itself,
# unit files, user, rights. Needs cargo-deb (cargo install cargo-deb --locked).
# usage: launch/package/build.sh [PROFILE], by default release; prints the path of the package
set -euo pipefail
cd "$(dirname "$0")/../.."
profile=${1:-release}
target=${CARGO_TARGET_DIR:-$PWD/target}
case "$profile" in
    dev) folder="$target/debug" ;;
    *) folder="$target/$profile" ;;
esac

cargo build --locked --quiet --profile "$profile" --bin farreach >&2
pages="$folder/package"
rm -rf "$pages"
mkdir -p "$pages/man"
"$folder/farreach" man "$pages/man"
gzip -9n "$pages/man"/*.1
for shell in bash zsh fish; do
    "$folder/farreach" completions "$shell" >"$pages/farreach.$shell"
done
cargo deb --locked --quiet --no-build --profile "$profile" --output "$folder/farreach.deb" >&2
echo "$folder/farreach.deb"

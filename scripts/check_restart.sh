#!/bin/sh
# Runs the first steps of a case once in one go, and once in two processes with a checkpoint between
# them and another number of threads: both must end in the same state, to the bit.
#
#   scripts/check_restart.sh CASE [STEPS]      (20 steps by default; needs the program built)
set -eu
case=$1
steps=${2:-20}
half=$((steps / 2))
ballast=${BALLAST:-target/release/ballast}
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT

hash_of() {
    sed -n 's/.*"state_hash": *"\([0-9a-f]*\)".*/\1/p' "$1/summary.json"
}

"$ballast" run "$case" --steps "$steps" --threads 1 --out "$out/whole" >"$out/log" 2>&1 ||
    { cat "$out/log" >&2; exit 1; }
expected=$(hash_of "$out/whole")
[ -n "$expected" ]
"$ballast" run "$case" --steps "$half" --threads 2 --out "$out/parts" >"$out/log" 2>&1
"$ballast" resume "$out/parts/checkpoint.h5" --steps "$steps" --threads 2 --expect "$expected" >"$out/log" 2>&1 ||
    { cat "$out/log" >&2; exit 1; }
echo "$case: $steps steps, restored in another process after $half: $expected"

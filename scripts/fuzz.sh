#!/usr/bin/env bash
# Builds the fuzz targets with the counters that libFuzzer follows (stable Rust has them), and runs each for some
# seconds:
#     scripts/fuzz.sh [SECONDS [TARGET...]]
# What is found, and what was learned, stays below target/fuzz.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=${1:-60}
shift || true
[ $# -gt 0 ] || set -- case_file file message hull pair

scripts/setup.sh
host=$(rustc -vV | sed -n 's/^host: //p')
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
coverage+=" -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
coverage+=" -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares"
# With a target named, what runs while building is compiled without counters.
RUSTFLAGS="$coverage" cargo build --profile fuzz --locked -p ballast-fuzz --features libfuzzer \
    --target "$host" --target-dir target/fuzz/build

# Where each target starts from.
seeds() {
    case $1 in
    case_file) cp examples/*.toml "$2" ;;
    file) cp interfaces/hdf5/tests/data/*.hdf5 examples/*.mcap "$2" ;;
    esac
}

result=0
for target in "$@"; do
    echo "== $target"
    mkdir -p "target/fuzz/$target/corpus" "target/fuzz/$target/findings"
    seeds "$target" "target/fuzz/$target/corpus"
    "target/fuzz/build/$host/fuzz/$target" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 \
        -print_final_stats=1 -artifact_prefix="target/fuzz/$target/findings/" "target/fuzz/$target/corpus" \
        >"target/fuzz/$target/log" 2>&1 || result=1
    tail -n 25 "target/fuzz/$target/log" | grep -E "stat::number|SUMMARY|panicked|ERROR" || true
done
exit "$result"

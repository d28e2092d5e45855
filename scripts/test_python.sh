#!/usr/bin/env bash
# Installs the Python package in an environment below target/, as a user would, and runs its tests. The first
# time fetches what they need.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/python.sh
target/python/bin/pip install --quiet --disable-pip-version-check "./bindings/python[test]"
# Tests compare with the program.
[ -x target/release/ballast ] || cargo build --release --locked --bin ballast
target/python/bin/python -m pytest bindings/python "$@"

#!/usr/bin/env bash
# Installs the Python package in an environment of its own below target/, as a user would, and runs its
# tests. The first time fetches what they need.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh python
venv=target/python
[ -x "$venv/bin/python" ] || python3 -m venv "$venv"
"$venv/bin/pip" install --quiet --disable-pip-version-check "./bindings/python[test]"
# Tests compare with the program.
[ -x target/release/ballast ] || cargo build --release --locked --bin ballast
"$venv/bin/python" -m pytest bindings/python "$@"

#!/usr/bin/env bash
# Installs the Python package with pip in the virtual environment target/python and runs its tests.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/python.sh
target/python/bin/pip install --quiet --disable-pip-version-check "./bindings/python[test]"
# CoFmuPy and the FMPy that it needs, older than that of the environment; other requirements are for its servers and plots.
[ -d target/cofmupy ] || target/python/bin/pip install --quiet --disable-pip-version-check --no-deps --target target/cofmupy \
    cofmupy==1.0.0 fmpy==0.3.20
# Tests compare results with those of the program.
[ -x target/release/ballast ] || cargo build --release --locked --bin ballast
# Files in parallel: most tests compute with one thread, and many wait for processes.
target/python/bin/python -m pytest bindings/python --numprocesses auto --dist loadfile "$@"

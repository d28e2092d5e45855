#!/usr/bin/env bash
# Makes an environment of its own below target/ with the Python packages that tests of examples and of results need.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh python
[ -x target/python/bin/python ] || python3 -m venv target/python
target/python/bin/pip install --quiet --disable-pip-version-check 'eclipse-zenoh==1.10.2' vtk

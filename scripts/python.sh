#!/usr/bin/env bash
# Creates a virtual environment in target/python with the packages that tests of examples and results need.
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/setup.sh python
[ -x target/python/bin/python ] || python3 -m venv target/python
target/python/bin/pip install --quiet --disable-pip-version-check 'eclipse-zenoh==1.10.2' vtk

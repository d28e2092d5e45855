#!/bin/sh
# An environment with the Python packages that tests of examples need: target/python.
# Without it those tests say that they are skipped.
set -eu
cd "$(dirname "$0")/.."
if [ ! -x target/python/bin/python ]; then
    python3 -m venv target/python
fi
target/python/bin/pip install --quiet --disable-pip-version-check 'eclipse-zenoh==1.10.2'

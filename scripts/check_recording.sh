#!/bin/sh
# Opens recordings with readers that other people wrote: every message is decoded twice, by
# mcap-ros2-support and by rosbags, each from the definitions embedded in the file, and compared.
# The Python packages go into an environment that is made for it and removed afterwards.
#
#   scripts/check_recording.sh FILE...
set -eu
here=$(dirname "$0")
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place/venv"
"$place/venv/bin/pip" install --quiet --disable-pip-version-check mcap mcap-ros2-support rosbags
"$place/venv/bin/python" "$here/check_recording.py" "$@"

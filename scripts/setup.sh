#!/usr/bin/env bash
# Installs what a build needs beyond Rust, make and a C compiler: the HDF5 library and pkg-config; with the
# argument `python` also Python's virtual environments, with `aarch64` a linker and an emulator for that processor.
# Does nothing where they are there. Says what it does before it does it.
set -euo pipefail

need=()
command -v pkg-config >/dev/null || need+=(pkg-config)
pkg-config --exists hdf5 2>/dev/null || pkg-config --exists hdf5-serial 2>/dev/null || need+=(libhdf5-dev)
if [ "${1:-}" = python ] && ! python3 -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    need+=(python3 python3-venv)
fi
if [ "${1:-}" = aarch64 ]; then
    command -v aarch64-linux-gnu-gcc >/dev/null || need+=(gcc-aarch64-linux-gnu libc6-dev-arm64-cross)
    command -v qemu-aarch64-static >/dev/null || need+=(qemu-user-static)
fi

if ! command -v cargo >/dev/null; then
    echo "setup: cargo is missing. Install Rust 1.89 or later (https://rustup.rs), then try again." >&2
    exit 1
fi
if [ ${#need[@]} -eq 0 ]; then
    exit 0
fi
if ! command -v apt-get >/dev/null; then
    echo "setup: ${need[*]} missing, and there is no apt-get here. Install the HDF5 development" >&2
    echo "setup: files (1.10 or later) and pkg-config with this system's package manager." >&2
    exit 1
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        echo "setup: ${need[*]} missing. As root: apt-get install ${need[*]}" >&2
        exit 1
    fi
    as_root=(sudo)
fi
# Another apt may hold the lock for a while.
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=400)
echo "setup: installing ${need[*]} with ${as_root[*]:+${as_root[*]} }apt-get" >&2
"${apt[@]}" update -qq || echo "setup: the package lists could not be refreshed; trying the existing ones" >&2
"${apt[@]}" install -y --no-install-recommends "${need[@]}"

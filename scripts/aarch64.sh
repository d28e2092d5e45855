#!/usr/bin/env bash
# Builds the core for aarch64 and runs its tests there, on an emulator where this machine is of another kind (Debian or Ubuntu;
# the Rust toolchain from rustup). One of them, of a shaken heap, knows the bytes that every machine has to come to:
#     scripts/aarch64.sh [TEST...]        by default: solver component physics
# An emulator takes some hundred times as long.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -gt 0 ] || set -- solver component physics
scripts/setup.sh aarch64
target=aarch64-unknown-linux-gnu
rustup target add "$target"
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -L /usr/aarch64-linux-gnu"
for test in "$@"; do
    cargo test --release --locked -p ballast --target "$target" --test "$test"
done

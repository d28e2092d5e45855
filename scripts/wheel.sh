#!/usr/bin/env bash
# Builds target/wheel/ballast-*.whl: package, program and library of units with HDF5 inside, which need Python and a C library of
# the version named below. The compiler of C code (zig) and cmake come from PyPI; all that is built stays in target/wheel-build.
set -euo pipefail
cd "$(dirname "$0")/.."

glibc=2.28
build=$PWD/target/wheel-build
if ! command -v cargo >/dev/null; then
    echo "wheel: cargo is missing. Install Rust 1.89 or later (https://rustup.rs), then try again." >&2
    exit 1
fi
[ -x "$build/tools/bin/python" ] || python3 -m venv "$build/tools"
"$build/tools/bin/pip" install --quiet --disable-pip-version-check --only-binary :all: \
    'maturin==1.16.0' 'ziglang==0.17.1' 'cmake==4.4.5' 'wheel==0.48.0' 'auditwheel==6.8.2' pytest
export PATH=$build/tools/bin:$PATH
export CARGO_ZIGBUILD_CACHE_DIR=$build/zig ZIG_GLOBAL_CACHE_DIR=$build/zig ZIG_LOCAL_CACHE_DIR=$build/zig

# The program depends on the library of units, so cargo builds this library with it.
rm -rf "$build/package" "$build/program" "$build/content" target/wheel
for part in bindings/python:package interfaces/cli:program; do
    maturin build --manifest-path "${part%:*}/Cargo.toml" --out "$build/${part#*:}" --target-dir "$build" --profile wheel \
        --locked --features ballast-hdf5/static --zig --compatibility "manylinux_${glibc/./_}" --auditwheel check --strip
done

wheel unpack --dest "$build/content" "$build"/package/*.whl
content=$(echo "$build"/content/*)
name=$(basename "$content")
built=$build/$(rustc -vV | sed -n 's/^host: //p')/wheel
install -D "$built/ballast" "$content/$name.data/scripts/ballast"
install -D "$built/deps/libballast_fmu.so" "$content/$name.data/data/lib/ballast/libballast_fmu.so"
install -D -m 644 LICENSE "$content/$name.dist-info/licenses/LICENSE"
python scripts/third_party_licences.py bindings/python/Cargo.toml interfaces/cli/Cargo.toml \
    >"$content/$name.dist-info/licenses/THIRD-PARTY"
sed -i "s#$PWD#.#g" "$content/$name.dist-info"/sboms/*.json
sed -i '/^License-Expression/a License-File: LICENSE\nLicense-File: THIRD-PARTY' "$content/$name.dist-info/METADATA"
mkdir target/wheel
wheel pack --dest-dir target/wheel "$content"
auditwheel show target/wheel/*.whl
python -m pytest --noconftest bindings/python/tests/test_wheel.py
ls -l target/wheel

# make demo   a first tamping run in minutes, from a bare clone
# make test   everything the project checks of itself
# make check  format, lints and documentation, which a change must pass as well
# All install what is missing first (scripts/setup.sh); cargo alone does as well once it is there.

.PHONY: demo test test-rust test-python check format lints documentation setup

demo: setup
	# Without the network, which would take the compiler longer than all the rest.
	cargo run --release --locked --no-default-features -- run examples/first.toml --force

test: test-rust test-python

test-rust: setup
	scripts/python.sh
	cargo test --release --locked --workspace --no-fail-fast

test-python: setup
	scripts/test_python.sh

check: format lints documentation

format:
	@if cargo fmt --version >/dev/null 2>&1; then set -x; cargo fmt --all --check; \
	else echo "left out: cargo fmt is not installed"; fi

# The fuzz targets, too, without libFuzzer itself, which wants a C++ compiler: the library named here is not looked at.
lints: setup
	@if cargo clippy --version >/dev/null 2>&1; then set -x; CUSTOM_LIBFUZZER_PATH=/none/libfuzzer.a \
	cargo clippy --release --locked --workspace --all-targets --features ballast-fuzz/libfuzzer -- -D warnings; \
	else echo "left out: cargo clippy is not installed"; fi

documentation: setup
	RUSTDOCFLAGS='-D warnings' cargo doc --release --locked --workspace --lib --no-deps

setup:
	@scripts/setup.sh

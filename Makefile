# make demo   a first tamping run in minutes, from a bare clone
# make test   everything the project checks of itself
# Both install what is missing first (scripts/setup.sh); cargo alone does as well once it is there.

.PHONY: demo test setup check

demo: setup
	# Without the network, which would take the compiler longer than all the rest.
	cargo run --release --locked --no-default-features -- run examples/first.toml --force

test: setup
	scripts/python.sh
	cargo test --release --locked --workspace --no-fail-fast
	scripts/test_python.sh

# What a change must also pass: format, lints, documentation.
check: setup
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --release --locked --workspace --lib --no-deps

setup:
	@scripts/setup.sh

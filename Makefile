# make demo   a first tamping run in minutes, from a bare clone
# make test   everything the project checks of itself
# make check  format, lints and documentation, which a change must pass as well
# make docs   the generated pages of the documentation, from schema, program, messages and stub
# make book   the documentation as a book, in target/book
# make wheel  package, program and library of units in one wheel that needs no compiler, in target/wheel
# All but the last two install what is missing first (scripts/setup.sh); cargo alone does as well once it is there.

.PHONY: demo test test-rust test-python test-book check format lints documentation docs book wheel setup

demo: setup
	# Without the network, which would take the compiler longer than all the rest.
	cargo run --release --locked --no-default-features -- run examples/slice.toml --force

test: test-rust test-python test-book

test-rust: setup
	scripts/python.sh
	cargo test --release --locked --workspace --no-fail-fast

test-python: setup
	scripts/test_python.sh

test-book:
	cargo test --locked --manifest-path tests/book/Cargo.toml --target-dir target/book-build

check: format lints documentation

# Parts of Rust that are not installed everywhere: a line that needs one ends there, and says so.
needs = cargo $(1) --version >/dev/null 2>&1 || { echo "left out: cargo $(1) is not installed"; exit 0; }; set -x

format:
	@$(call needs,fmt); cargo fmt --all --check

# The fuzz targets, too, which nothing else compiles: without clippy they are at least checked. Without libFuzzer
# itself, which wants a C++ compiler: the library named here is not looked at.
lints: export CUSTOM_LIBFUZZER_PATH = /none/libfuzzer.a
lints: setup
	@cargo clippy --version >/dev/null 2>&1 || { set -x; \
	cargo check --release --locked -p ballast-fuzz --features libfuzzer; }
	@$(call needs,clippy); \
	cargo clippy --release --locked --workspace --all-targets --features ballast-fuzz/libfuzzer -- -D warnings

documentation: setup
	RUSTDOCFLAGS='-D warnings' cargo doc --release --locked --workspace --lib --no-deps

# The same tests as in `make test`, which write their pages here.
docs: export BALLAST_WRITE_DOCS = 1
docs: setup
	cargo test --release --locked -p ballast-scenario --lib reference
	cargo test --release --locked -p ballast-cli --test program reference
	cargo test --release --locked -p ballast-tidy reference
	python3 bindings/python/tests/test_reference.py

book:
	cargo run --locked --manifest-path tests/book/Cargo.toml --target-dir target/book-build

wheel:
	scripts/wheel.sh

setup:
	@scripts/setup.sh

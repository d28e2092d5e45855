//! Features of dependencies, equal in the program and the Python package; see `Cargo.toml`.

//! Units of a small case, driven through the C functions of both versions.

mod beds;
mod driver;
mod random_calls;
mod states;
mod steps;

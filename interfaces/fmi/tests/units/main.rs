//! Units of a small case, driven through the C functions of both versions.

mod beds;
mod driver;
mod random_calls;
#[cfg(feature = "zenoh")]
mod served;
mod states;
mod steps;

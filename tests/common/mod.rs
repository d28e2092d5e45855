//! Shared by the physics and solver checks.

#![allow(dead_code, reason = "each test binary uses its part")]

pub mod heap;
pub mod scene;

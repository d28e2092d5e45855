//! Files of Ballast: what is written is read, what is damaged is refused.

mod checkpoint;
mod damage;
mod fclib;
mod fclib_broken;
mod inspect;
mod results;
mod scene;

/// Says that a test, or a part of one, cannot run here: past the test harness, which would keep it to itself.
fn left_out(why: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "LEFT OUT: {why}");
}

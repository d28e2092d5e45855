//! One suite over every schedule and number of threads: equal bytes, equal physics, restarts,
//! refusals.

#[path = "../common/mod.rs"]
mod common;

mod complementarity;
mod machines;
mod refusal;
mod restart;
mod schedules;
mod threads;

use ballast::state::State;

/// Runs `work` on that many threads.
fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(work)
}

/// Returns the bits of every number of the state; unlike `==` they distinguish 0 from -0 and compare NaN.
fn bits(state: &State) -> Vec<u64> {
    let mut bits = vec![state.step, state.time_ns];
    let mut add = |x: f64| bits.push(x.to_bits());
    for v in [&state.position, &state.velocity, &state.angular_velocity].into_iter().flatten() {
        v.iter().for_each(|&x| add(x));
    }
    state.orientation.iter().flat_map(|q| q.coords.iter()).for_each(|&x| add(x));
    state.driver.values.iter().for_each(|&x| add(x));
    let memory = &state.contacts;
    for v in [&memory.local_point, &memory.impulse].into_iter().flatten() {
        v.iter().for_each(|&x| add(x));
    }
    let e = &state.energy;
    for x in
        [e.initial_kinetic, e.initial_potential, e.kinetic, e.potential, e.work_in, e.dissipated]
    {
        add(x);
    }
    bits.extend(memory.bodies.iter().flatten().map(|&b| u64::from(b)));
    bits.extend(&memory.feature);
    bits
}

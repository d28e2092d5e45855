//! Contact visits per second of one core, by instructions and size of the set.
//!
//! `cargo bench --bench sweep` prints CSV: instructions, contacts, size of blocks and lines, visits
//! per second of CPU time.

#[path = "../src/nlgs/scenes.rs"]
#[allow(dead_code)]
mod scenes;

use ballast::nlgs::{Arithmetic, ContactSet};
use scenes::Scene;

/// CPU time of this thread, s: the machine may be shared. Wall time where the system does not tell.
fn cpu_seconds(start: std::time::Instant) -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok())
        .map_or_else(|| start.elapsed().as_secs_f64(), |ns| 1e-9 * ns)
}

fn main() {
    let start = std::time::Instant::now();
    println!("instructions,contacts,megabytes,million_visits_per_s");
    for size in [[12, 12, 8], [20, 20, 10], [40, 40, 40]] {
        let scene = Scene::grid(size, 1, 0.0, 13);
        let problem = &scene.problem;
        let contacts: Vec<u32> = (0..problem.contacts.len() as u32).collect();
        let grains: Vec<u32> = (0..problem.body_count() as u32).collect();
        for arithmetic in Arithmetic::available() {
            let mut set = ContactSet::default();
            set.set_arithmetic(arithmetic);
            set.pack(problem, &contacts, grains.len(), |grain| grains[grain as usize]);
            set.lines[..grains.len()].copy_from_slice(&problem.lines);
            set.apply_impulses();
            let slow = arithmetic == Arithmetic::PORTABLE && cfg!(target_arch = "x86_64");
            let visits = if slow { 100_000 } else { 1_500_000 };
            let sweeps = (visits / set.contact_count()).max(1);
            let megabytes = 1e-6 * (160 * contacts.len() + 64 * grains.len()) as f64;
            // The best of several: the machine may be shared.
            let mut best = 0.0_f64;
            for _ in 0..8 {
                let before = cpu_seconds(start);
                for _ in 0..sweeps {
                    set.sweep(1.0);
                }
                let time = cpu_seconds(start) - before;
                best = best.max(1e-6 * (sweeps * set.contact_count()) as f64 / time);
            }
            println!("{arithmetic:?},{},{megabytes:.2},{best:.1}", contacts.len());
        }
    }
}

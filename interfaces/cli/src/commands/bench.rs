//! `ballast bench ...`: what the program costs, measured.

use crate::bench::args::Bench;
use crate::bench::{cost, detection, iterations, kernel, sample, step, subdomains, tables};
use crate::console::Console;
use crate::exit::Outcome;

pub fn bench(what: Bench, console: Console) -> Outcome {
    match what {
        Bench::Sample(args) => sample::sample(args),
        Bench::Kernel(args) => kernel::kernel(&args, console),
        Bench::Detection(args) => detection::detection(&args, console),
        Bench::Step(args) => step::step(&args, console),
        Bench::Tables(args) => tables::tables(&args, console),
        Bench::Cost(args) => cost::cost(&args, console),
        Bench::Subdomains(args) => subdomains::subdomains(&args, console),
        Bench::Iterations(args) => iterations::iterations(&args, console),
    }
}

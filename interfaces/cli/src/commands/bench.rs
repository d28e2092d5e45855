//! `ballast bench ...`: what the program costs, measured.

use crate::console::Console;
use crate::exit::Outcome;
use ballast_benches::args::Bench;
use ballast_benches::{cost, detection, iterations, kernel, sample, step, subdomains, tables};

pub fn bench(what: Bench, console: Console) -> Outcome {
    match what {
        Bench::Sample(args) => sample::sample(args, &console),
        Bench::Kernel(args) => kernel::kernel(&args, &console),
        Bench::Detection(args) => detection::detection(&args, &console),
        Bench::Step(args) => step::step(&args, &console),
        Bench::Tables(args) => tables::tables(&args, &console),
        Bench::Cost(args) => cost::cost(&args, &console),
        Bench::Subdomains(args) => subdomains::subdomains(&args, &console),
        Bench::Iterations(args) => iterations::iterations(&args, &console),
    }
}

//! `ballast bench ...`: measurements of the performance.

use ballast_benches::args::BenchCommand;
use ballast_session::{Reporter, Result};

pub fn bench(command: BenchCommand, console: &dyn Reporter) -> Result {
    match command {
        BenchCommand::Sample(args) => ballast_benches::sample(args, console),
        BenchCommand::Kernel(args) => ballast_benches::kernel(&args, console),
        BenchCommand::Detection(args) => ballast_benches::detection(&args, console),
        BenchCommand::Step(args) => ballast_benches::step(&args, console),
        BenchCommand::Hoang2012(args) => ballast_benches::hoang2012(&args, console),
        BenchCommand::WorkPrecision(args) => ballast_benches::work_precision(&args, console),
        BenchCommand::Subdomains(args) => ballast_benches::subdomains(&args, console),
        BenchCommand::Convergence(args) => ballast_benches::convergence(&args, console),
    }
}

//! `ballast bench kernel`: contact visits per second, against a roofline measured in the same rounds.
//!
//! Bytes and operations of a visit are counted: bytes from the layout of the blocks, operations by a sweep with
//! lanes that count. Every sweep visits every contact.

use super::StageLabel;
use super::args::KernelArgs;
use super::kernel_load::{KernelLoad, kernel_loads};
use super::machine_info::MachineInfo;
use super::pools::pools;
use super::result_sheet::{ResultSheet, cells};
use super::roofline::{FIRST_CACHE_BYTES, Rate, RooflineLimits, Triad, arithmetic_rates};
use ballast::lanes::InstructionSet;
use ballast_session::statistics::Quartiles;
use ballast_session::{Failure, Reporter, Result};
use rayon::ThreadPool;
use std::sync::Arc;

const COLUMNS: &[&str] = &[
    "lattice",
    "form",
    "instructions",
    "threads",
    "contacts",
    "kilobytes",
    "mvisits_per_s",
    "low",
    "high",
    "per_core_and_cpu_s",
    "bytes_per_visit",
    "core_bytes_per_visit",
    "flops_per_visit",
    "triad_gb_per_s",
    "peak_gflops",
    "roof_mvisits_per_s",
    "bound_by",
    "of_roof_percent",
    "of_peak_percent",
];

/// Largest lattice; its contact set takes seven gigabytes.
const MAX_EDGE: usize = 128;

/// Measurement of a load on one number of threads with one instruction set.
struct KernelMeasurement {
    load: usize,
    instructions: InstructionSet,
    pool: Arc<ThreadPool>,
    rounds: Vec<KernelRound>,
}

impl KernelMeasurement {
    fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }
}

/// One round of a measurement.
struct KernelRound {
    /// Visits per second.
    rate: Rate,
    roofs: RooflineLimits,
    roof: f64,
    bound_by: &'static str,
}

/// Measures the contact kernel.
///
/// # Errors
/// An option out of range, or a file that cannot be written.
pub fn kernel(args: &KernelArgs, console: &dyn Reporter) -> Result {
    check(args)?;
    let machine = MachineInfo::observe();
    let pools = pools(&args.threads)?;
    let edge = args.edge.get();
    let mut sheet = ResultSheet::new(COLUMNS);
    let max_threads = pools.last().map_or(1, |pool| pool.current_num_threads());
    let loads = kernel_loads(edge, max_threads, &mut sheet);
    let mut measurements = measurements(&loads, &pools);
    measure(&loads, &mut measurements, args, console);
    notes(&mut sheet);
    for measurement in &measurements {
        if measurement.threads() == 1 && measurement.instructions == InstructionSet::detect() {
            let load = &loads[measurement.load];
            sheet.section(format!("{}, {}", load.lattice, load.form()));
        }
        row(&mut sheet, &loads[measurement.load], measurement);
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

fn check(args: &KernelArgs) -> Result {
    let (edge, seconds) = (args.edge.get(), args.seconds);
    if edge > MAX_EDGE {
        return Err(Failure::Usage(format!("--edge {edge}: expected at most {MAX_EDGE}")));
    }
    if !(seconds > 0.0 && seconds <= 60.0) {
        let text = format!("--seconds {seconds}: expected a time above 0 s and up to 60 s");
        return Err(Failure::Usage(text));
    }
    Ok(())
}

fn notes(sheet: &mut ResultSheet) {
    for (word, text) in [
        (
            "mvisits_per_s",
            "10⁶ contact visits per second of wall time: median, low and high quartile",
        ),
        ("per_core_and_cpu_s", "visits per core and second of its CPU time"),
        (
            "bytes_per_visit",
            "minimum traffic with empty caches: 160 per pair, written lines, grains",
        ),
        ("core_bytes_per_visit", "loads and stores of a visit"),
        ("flops_per_visit", "counted: products, sums, divisions and roots; a fused one is two"),
        ("triad_gb_per_s", "a = b + s a on an equal number of bytes: two reads and a write"),
        ("peak_gflops", "independent chains of fused operations with the same instructions"),
        (
            "roof",
            "the least of: triad in the first cache over core bytes, triad over bytes, peak over operations \
             issued, divisions; fractions are medians over rounds, by the CPU clock",
        ),
    ] {
        sheet.note(word, text);
    }
}

fn measurements(loads: &[KernelLoad], pools: &[Arc<ThreadPool>]) -> Vec<KernelMeasurement> {
    let mut measurements = Vec::new();
    for (load, of) in loads.iter().enumerate() {
        let fits =
            |pool: &&Arc<ThreadPool>| of.divided || pool.current_num_threads() <= of.sets.len();
        for pool in pools.iter().filter(fits) {
            for instructions in InstructionSet::available() {
                measurements.push(KernelMeasurement {
                    load,
                    instructions,
                    pool: pool.clone(),
                    rounds: Vec::new(),
                });
            }
        }
    }
    measurements
}

/// Measures roofline and measurements in alternation.
fn measure(
    loads: &[KernelLoad],
    measurements: &mut [KernelMeasurement],
    args: &KernelArgs,
    console: &dyn Reporter,
) {
    let (rounds, seconds) = (args.rounds.get(), args.seconds);
    let mut triads: Vec<Triad> = Vec::new();
    for measurement in &*measurements {
        for bytes in
            [FIRST_CACHE_BYTES, loads[measurement.load].bytes_per_thread(measurement.threads())]
        {
            if !triads.iter().any(|t| t.matches(bytes, measurement.threads())) {
                triads.push(Triad::new(bytes, measurement.threads()));
            }
        }
    }
    let all = rounds as usize * measurements.len();
    let mut progress = console.start_progress("kernel");
    for k in 0..all {
        // Each round begins with another measurement.
        let (round, place) = (k / measurements.len(), k % measurements.len());
        let i = (round + place) % measurements.len();
        let measurement = &mut measurements[i];
        let (load, pool) = (&loads[measurement.load], &measurement.pool);
        let bandwidth = |bytes| {
            let triad = triads.iter().find(|t| t.matches(bytes, measurement.threads()));
            triad.map_or(0.0, |triad| triad.bandwidth(pool, seconds).cpu)
        };
        let (first_cache, set) =
            (bandwidth(FIRST_CACHE_BYTES), bandwidth(load.bytes_per_thread(measurement.threads())));
        let [fused, divisions] =
            arithmetic_rates(measurement.instructions, pool, seconds).map(|r| r.cpu);
        let rate = load.rate(measurement.instructions, pool, seconds);
        let roofs = RooflineLimits { first_cache, set, fused, divisions };
        let (roof, bound_by) = roofs.lowest(&load.traffic, &load.operations, load.contacts as f64);
        measurement.rounds.push(KernelRound { rate, roofs, roof, bound_by });
        progress.advance((k + 1) as f64 / all as f64, &StageLabel(format!("round {}", round + 1)));
    }
}

fn row(sheet: &mut ResultSheet, load: &KernelLoad, measurement: &KernelMeasurement) {
    let threads = measurement.threads() as f64;
    let of = |value: &dyn Fn(&KernelRound) -> f64| {
        Quartiles::of(&measurement.rounds.iter().map(value).collect::<Vec<_>>())
    };
    let rate = of(&|t| t.rate.wall);
    let contacts = load.contacts as f64;
    let flops = load.operations.flops() as f64 / contacts;
    let mut by_roof: Vec<&KernelRound> = measurement.rounds.iter().collect();
    by_roof.sort_by(|a, b| a.roof.total_cmp(&b.roof));
    sheet.row(cells![
        load.lattice.clone(),
        load.form(),
        measurement.instructions.name(),
        measurement.threads(),
        load.visits(measurement.threads()),
        1e-3 * load.traffic.footprint as f64,
        1e-6 * rate.median,
        1e-6 * rate.low,
        1e-6 * rate.high,
        1e-6 * of(&|t| t.rate.cpu).median / threads,
        load.traffic.streamed as f64 / contacts,
        load.traffic.core as f64 / contacts,
        flops,
        1e-9 * of(&|t| t.roofs.set).median,
        2e-9 * of(&|t| t.roofs.fused).median,
        1e-6 * of(&|t| t.roof).median,
        by_roof[by_roof.len() / 2].bound_by,
        100.0 * of(&|t| t.rate.cpu / t.roof).median,
        100.0 * of(&|t| t.rate.cpu * flops / (2.0 * t.roofs.fused)).median,
    ]);
}

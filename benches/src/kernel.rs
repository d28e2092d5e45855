//! `ballast bench kernel`: contact visits per second, against a roofline measured in the same turns.
//!
//! Bytes and operations of a visit are counted: bytes from the layout of the blocks, operations by a sweep with
//! lanes that count. Every sweep visits every contact.

use super::Said;
use super::args::BenchKernel;
use super::loads::{Load, loads};
use super::machine::Machine;
use super::pools::pools;
use super::roof::{FIRST_CACHE, Rate, Roofs, Triad, arithmetic_rates};
use super::sheet::{Sheet, cells};
use ballast::lanes::InstructionSet;
use ballast_session::Reporter;
use ballast_session::statistics::Quartiles;
use ballast_session::{Failure, Outcome};
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

/// Its set takes seven gigabytes.
const LARGEST_EDGE: usize = 128;

/// A load on some threads with some instructions.
struct Figure {
    load: usize,
    arithmetic: InstructionSet,
    pool: Arc<ThreadPool>,
    turns: Vec<Turn>,
}

impl Figure {
    fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }
}

/// One measurement of a figure.
struct Turn {
    /// Visits per second.
    rate: Rate,
    roofs: Roofs,
    roof: f64,
    bound_by: &'static str,
}

pub fn kernel(args: &BenchKernel, console: &dyn Reporter) -> Outcome {
    check(args)?;
    let machine = Machine::watch();
    let pools = pools(&args.threads)?;
    let edge = args.edge.get();
    let mut sheet = Sheet::new(COLUMNS);
    let most = pools.last().map_or(1, |pool| pool.current_num_threads());
    let loads = loads(edge, most, &mut sheet);
    let mut figures = figures(&loads, &pools);
    measure(&loads, &mut figures, args, console);
    notes(&mut sheet);
    for figure in &figures {
        if figure.threads() == 1 && figure.arithmetic == InstructionSet::detect() {
            let load = &loads[figure.load];
            sheet.section(format!("{}, {}", load.lattice, load.form()));
        }
        row(&mut sheet, &loads[figure.load], figure);
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

fn check(args: &BenchKernel) -> Outcome {
    let (edge, seconds) = (args.edge.get(), args.seconds);
    if edge > LARGEST_EDGE {
        return Err(Failure::Usage(format!("--edge {edge}: expected at most {LARGEST_EDGE}")));
    }
    if !(seconds > 0.0 && seconds <= 60.0) {
        let text = format!("--seconds {seconds}: expected a time above 0 s and up to 60 s");
        return Err(Failure::Usage(text));
    }
    Ok(())
}

fn notes(sheet: &mut Sheet) {
    for (word, text) in [
        (
            "mvisits_per_s",
            "10⁶ contact visits per second of wall time: median, low and high quartile",
        ),
        ("per_core_and_cpu_s", "the same per core and second of its CPU time"),
        (
            "bytes_per_visit",
            "moved at least when nothing is left in a cache: 160 per pair, written lines, grains",
        ),
        ("core_bytes_per_visit", "loads and stores of a visit"),
        ("flops_per_visit", "counted: products, sums, divisions and roots; a fused one is two"),
        ("triad_gb_per_s", "a = b + s a on as many bytes: two reads and a write of what was read"),
        ("peak_gflops", "independent chains of fused operations with the same instructions"),
        (
            "roof",
            "the least of: triad in the first cache over core bytes, triad over bytes, peak over operations \
             issued, divisions; fractions are medians over turns, by the CPU clock",
        ),
    ] {
        sheet.note(word, text);
    }
}

fn figures(loads: &[Load], pools: &[Arc<ThreadPool>]) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (load, of) in loads.iter().enumerate() {
        let fits =
            |pool: &&Arc<ThreadPool>| of.divided || pool.current_num_threads() <= of.sets.len();
        for pool in pools.iter().filter(fits) {
            for arithmetic in InstructionSet::available() {
                figures.push(Figure { load, arithmetic, pool: pool.clone(), turns: Vec::new() });
            }
        }
    }
    figures
}

/// Measures roofs and figures in turn.
fn measure(loads: &[Load], figures: &mut [Figure], args: &BenchKernel, console: &dyn Reporter) {
    let (rounds, seconds) = (args.rounds.get(), args.seconds);
    let mut triads: Vec<Triad> = Vec::new();
    for figure in &*figures {
        for bytes in [FIRST_CACHE, loads[figure.load].bytes_each(figure.threads())] {
            if !triads.iter().any(|t| t.is(bytes, figure.threads())) {
                triads.push(Triad::new(bytes, figure.threads()));
            }
        }
    }
    let all = rounds as usize * figures.len();
    let mut progress = console.start_progress("kernel");
    for k in 0..all {
        // Another one begins each round.
        let (round, place) = (k / figures.len(), k % figures.len());
        let i = (round + place) % figures.len();
        let figure = &mut figures[i];
        let (load, pool) = (&loads[figure.load], &figure.pool);
        let bandwidth = |bytes| {
            let triad = triads.iter().find(|t| t.is(bytes, figure.threads()));
            triad.map_or(0.0, |triad| triad.bandwidth(pool, seconds).cpu)
        };
        let (first_cache, set) =
            (bandwidth(FIRST_CACHE), bandwidth(load.bytes_each(figure.threads())));
        let [fused, divisions] = arithmetic_rates(figure.arithmetic, pool, seconds).map(|r| r.cpu);
        let rate = load.rate(figure.arithmetic, pool, seconds);
        let roofs = Roofs { first_cache, set, fused, divisions };
        let (roof, bound_by) = roofs.least(&load.traffic, &load.operations, load.contacts as f64);
        figure.turns.push(Turn { rate, roofs, roof, bound_by });
        progress.advance((k + 1) as f64 / all as f64, &Said(format!("turn {}", round + 1)));
    }
}

fn row(sheet: &mut Sheet, load: &Load, figure: &Figure) {
    let threads = figure.threads() as f64;
    let of = |value: &dyn Fn(&Turn) -> f64| {
        Quartiles::of(&figure.turns.iter().map(value).collect::<Vec<_>>())
    };
    let rate = of(&|t| t.rate.wall);
    let contacts = load.contacts as f64;
    let flops = load.operations.flops() as f64 / contacts;
    let mut by_roof: Vec<&Turn> = figure.turns.iter().collect();
    by_roof.sort_by(|a, b| a.roof.total_cmp(&b.roof));
    sheet.row(cells![
        load.lattice.clone(),
        load.form(),
        figure.arithmetic.name(),
        figure.threads(),
        load.visits(figure.threads()),
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

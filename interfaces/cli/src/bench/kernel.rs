//! `ballast bench kernel`: contact visits per second, against a roofline measured in the same turns.
//!
//! Bytes and operations of a visit are counted: bytes from the layout of the blocks, operations by a sweep with
//! lanes that count. Every sweep visits every contact.

use super::Said;
use super::args::BenchKernel;
use super::machine::Machine;
use super::pools::pools;
use super::roof::{FIRST_CACHE, Rate, Roofs, Triad, arithmetic_rates, enter};
use super::sheet::{Sheet, cells};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::progress::Progress;
use crate::statistics::Quartiles;
use ballast::model::PartitionRule;
use ballast::nlgs::scenes::Scene;
use ballast::nlgs::{Arithmetic, ContactSet, Operations, Traffic};
use ballast::partition::Partition;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

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

/// Lattices below the largest: sets for a first cache, a second cache, and of some 16 000 contacts.
const LATTICES: [[usize; 3]; 3] = [[3, 3, 4], [10, 10, 8], [16, 16, 14]];
/// Contacts of a subdomain: it fits a second cache.
const PER_SUBDOMAIN: u32 = 4000;
/// Sweeps before anything is measured: the first ones have more contacts that slip.
const SETTLING: usize = 20;
const LARGEST_EDGE: usize = 128;

/// Sets that are swept, and what a sweep over one thread's share (or all subdomains) is.
struct Load {
    lattice: String,
    divided: bool,
    /// A copy per thread, or subdomains.
    sets: Vec<Mutex<ContactSet>>,
    contacts: usize,
    traffic: Traffic,
    operations: Operations,
}

/// A load on some threads with some instructions.
struct Figure {
    load: usize,
    arithmetic: Arithmetic,
    threads: usize,
    turns: Vec<Turn>,
}

/// One measurement of a figure.
struct Turn {
    /// Visits per second.
    rate: Rate,
    roofs: Roofs,
    roof: f64,
    bound_by: &'static str,
}

pub fn kernel(args: &BenchKernel, console: Console) -> Outcome {
    check(args)?;
    let machine = Machine::watch();
    let pools = pools(&args.threads)?;
    let edge = args.edge.get();
    let mut sheet = Sheet::new(COLUMNS);
    let loads = loads(edge, pools.len(), &mut sheet);
    let mut figures = figures(&loads, pools.len());
    measure(&loads, &mut figures, &pools, args, console);
    notes(&mut sheet);
    for figure in &figures {
        if figure.threads == 1 && figure.arithmetic == Arithmetic::detect() {
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

impl Load {
    fn form(&self) -> &'static str {
        if self.divided { "subdomains" } else { "one set per thread" }
    }

    fn new(lattice: String, divided: bool, sets: Vec<ContactSet>) -> Self {
        let counted = if divided { &sets[..] } else { &sets[..1] };
        let (mut traffic, mut operations) = (Traffic::default(), Operations::default());
        for set in counted {
            let (more, done) = (set.traffic(), set.operations(1.0));
            traffic.held += more.held;
            traffic.core += more.core;
            traffic.streamed += more.streamed;
            operations.plain += done.plain;
            operations.fused += done.fused;
            operations.divisions += done.divisions;
        }
        let contacts = counted.iter().map(ContactSet::contact_count).sum();
        let sets = sets.into_iter().map(Mutex::new).collect();
        Self { lattice, divided, sets, contacts, traffic, operations }
    }

    /// Contacts that a sweep on some threads visits.
    fn visits(&self, threads: usize) -> usize {
        if self.divided { self.contacts } else { threads * self.contacts }
    }

    /// Bytes that each of some threads has to do with.
    fn bytes_each(&self, threads: usize) -> usize {
        if self.divided { self.traffic.held / threads } else { self.traffic.held }
    }

    /// Visits per second.
    fn rate(&self, arithmetic: Arithmetic, pool: &ThreadPool, seconds: f64) -> Rate {
        self.sets.iter().for_each(|set| enter(set).set_arithmetic(arithmetic));
        let threads = pool.current_num_threads();
        let rate = Rate::of(seconds, threads, |times| {
            if self.divided {
                for _ in 0..times {
                    pool.install(|| {
                        self.sets.par_iter().with_max_len(1).for_each(|set| enter(set).sweep(1.0));
                    });
                }
                return;
            }
            pool.broadcast(|thread| {
                let mut set = enter(&self.sets[thread.index()]);
                for _ in 0..times {
                    set.sweep(1.0);
                }
            });
        });
        rate.times(self.visits(threads) as f64)
    }
}

/// The sets to sweep: lattices below the largest and the largest as they are, then the largest in subdomains.
fn loads(edge: usize, threads: usize, sheet: &mut Sheet) -> Vec<Load> {
    let largest = [edge; 3];
    let grains = |size: &[usize; 3]| size.iter().product::<usize>();
    let below = LATTICES.into_iter().filter(|size| grains(size) < grains(&largest));
    let name = |[x, y, z]: [usize; 3]| format!("{x} x {y} x {z} grains");
    let mut loads: Vec<Load> = below
        .map(|size| {
            let set = whole(&Scene::grid(size, 1, 0.0, 13));
            Load::new(name(size), false, vec![set; threads])
        })
        .collect();
    let scene = Scene::grid(largest, 1, 0.0, 13);
    loads.push(Load::new(name(largest), false, vec![whole(&scene)]));
    let sets = subdomains(&scene);
    let (number, all) = (sets.len(), scene.contacts.len());
    let divided = Load::new(name(largest), true, sets);
    sheet.note(
        "subdomains",
        format!(
            "{number} of about {PER_SUBDOMAIN} contacts; {:.1} % of {all} contacts lie between them and are not swept",
            100.0 * (1.0 - divided.contacts as f64 / all as f64)
        ),
    );
    loads.push(divided);
    loads
}

/// All contacts of a scene as one set.
fn whole(scene: &Scene) -> ContactSet {
    let contacts: Vec<u32> = (0..scene.problem.contacts.len() as u32).collect();
    let grains: Vec<u32> = (0..scene.problem.body_count() as u32).collect();
    packed(scene, &contacts, &grains, &grains)
}

/// The subdomains of a scene, without what lies between them.
fn subdomains(scene: &Scene) -> Vec<ContactSet> {
    let mut partition = Partition::default();
    let positions = &scene.state.position[..scene.model.grains.len()];
    partition.divide(PartitionRule::ContactsPer(PER_SUBDOMAIN), positions, &scene.contacts);
    let mut line_of = vec![0; positions.len()];
    (0..partition.grains.len())
        .map(|s| {
            let grains = partition.grains.list(s);
            for (line, &grain) in (0..).zip(grains) {
                line_of[grain as usize] = line;
            }
            packed(scene, partition.contacts.list(s), grains, &line_of)
        })
        .collect()
}

/// A set that was swept a few times.
fn packed(scene: &Scene, contacts: &[u32], grains: &[u32], line_of: &[u32]) -> ContactSet {
    let mut set = ContactSet::default();
    set.pack(&scene.problem, contacts, grains.len(), |grain| line_of[grain as usize]);
    for (line, &grain) in set.lines.iter_mut().zip(grains) {
        *line = scene.problem.lines[grain as usize];
    }
    set.apply_impulses();
    (0..SETTLING).for_each(|_| set.sweep(1.0));
    set
}

fn figures(loads: &[Load], threads: usize) -> Vec<Figure> {
    let mut figures = Vec::new();
    for (load, of) in loads.iter().enumerate() {
        let most = if of.divided { threads } else { of.sets.len() };
        for threads in 1..=most {
            for arithmetic in Arithmetic::available() {
                figures.push(Figure { load, arithmetic, threads, turns: Vec::new() });
            }
        }
    }
    figures
}

/// Measures roofs and figures in turn.
fn measure(
    loads: &[Load],
    figures: &mut [Figure],
    pools: &[Arc<ThreadPool>],
    args: &BenchKernel,
    console: Console,
) {
    let (rounds, seconds) = (args.rounds.get(), args.seconds);
    let mut triads: Vec<Triad> = Vec::new();
    for figure in &*figures {
        for bytes in [FIRST_CACHE, loads[figure.load].bytes_each(figure.threads)] {
            if !triads.iter().any(|t| t.is(bytes, figure.threads)) {
                triads.push(Triad::new(bytes, figure.threads));
            }
        }
    }
    let all = rounds as usize * figures.len();
    let mut progress = Progress::start(console, "kernel", 0.0);
    for k in 0..all {
        // Another one begins each round.
        let (round, place) = (k / figures.len(), k % figures.len());
        let i = (round + place) % figures.len();
        let figure = &mut figures[i];
        let (load, pool) = (&loads[figure.load], &pools[figure.threads - 1]);
        let bandwidth = |bytes| {
            let triad = triads.iter().find(|t| t.is(bytes, figure.threads));
            triad.map_or(0.0, |triad| triad.bandwidth(pool, seconds).cpu)
        };
        let (first_cache, set) =
            (bandwidth(FIRST_CACHE), bandwidth(load.bytes_each(figure.threads)));
        let [fused, divisions] = arithmetic_rates(figure.arithmetic, pool, seconds).map(|r| r.cpu);
        let rate = load.rate(figure.arithmetic, pool, seconds);
        let roofs = Roofs { first_cache, set, fused, divisions };
        let (roof, bound_by) = roofs.least(&load.traffic, &load.operations, load.contacts as f64);
        figure.turns.push(Turn { rate, roofs, roof, bound_by });
        progress.advance((k + 1) as f64 / all as f64, &Said(format!("turn {}", round + 1)));
    }
}

fn row(sheet: &mut Sheet, load: &Load, figure: &Figure) {
    let threads = figure.threads as f64;
    let of = |value: &dyn Fn(&Turn) -> f64| {
        Quartiles::of(&figure.turns.iter().map(value).collect::<Vec<_>>())
    };
    let rate = of(&|t| t.rate.wall);
    let contacts = load.contacts as f64;
    let flops = load.operations.flops() as f64 / contacts;
    let middle = figure.turns.len() / 2;
    sheet.row(cells![
        load.lattice.clone(),
        load.form(),
        figure.arithmetic.name(),
        figure.threads,
        load.visits(figure.threads),
        1e-3 * load.traffic.held as f64,
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
        figure.turns[middle].bound_by,
        100.0 * of(&|t| t.rate.cpu / t.roof).median,
        100.0 * of(&|t| t.rate.cpu * flops / (2.0 * t.roofs.fused)).median,
    ]);
}

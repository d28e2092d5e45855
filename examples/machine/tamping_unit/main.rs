//! Tamps a served bed with a model of a tamping unit in the loop, and prints what the machine and the ballast did.
//!
//!     ballast serve examples/machine/tamping.toml --key demo/bed
//!     cargo run --release -p ballast-coupling --example tamping_unit -- demo/bed [WINDOWS] [ENDPOINT] [NAME=VALUE]...
//!
//! The unit (`model`) is the one of `machine.py`: same equations, parameters and names. The component and the unit are
//! coupled implicitly in windows of two time steps. `NAME=VALUE` sets a parameter of the unit; the values here are those of
//! the case above.

mod model;

use ballast_coupling::{Coupling, CouplingSettings, Window};
use ballast_protocol::description::{BodyDescription, ComponentDescription, TineDescription};
use ballast_zenoh::session::DEFAULT_ENDPOINT;
use ballast_zenoh::{Client, SessionConfig, Timeouts};
use model::{Parameters, Phase, Sleeper, TampingUnit, Tine};
use std::collections::BTreeSet;
use std::error::Error;

/// Number of windows from one line of progress to the next.
const WINDOWS_PER_LINE: usize = 50;

/// Figures of the run.
#[derive(Default)]
struct RunFigures {
    iterations: Vec<u32>,
    windows_not_converged: usize,
    steps: u64,
    steps_not_converged: u64,
    depth: f64,
    peak_pressure: f64,
    peak_force: f64,
    given: f64,
    received: f64,
    /// Work in the squeeze: cycle, pair, J.
    squeeze_work: Vec<(usize, usize, f64)>,
    hash: String,
}

impl RunFigures {
    /// Adds a window that began in a phase of a cycle.
    fn add(&mut self, window: &Window, unit: &TampingUnit, (phase, cycle): (Phase, usize)) {
        self.iterations.push(window.iterations);
        self.windows_not_converged += usize::from(!window.is_converged);
        self.steps += window.reply.steps;
        self.steps_not_converged += window.reply.solver.steps_not_converged;
        self.given += window.work_given;
        self.received += window.work_received;
        self.hash = window.reply.hash.to_string();
        for row in unit.trace() {
            self.depth = self.depth.max(row.depth);
            self.peak_pressure = row.pressure.iter().copied().fold(self.peak_pressure, f64::max);
            self.peak_force = row.force.iter().copied().fold(self.peak_force, f64::max);
        }
        if phase == Phase::Squeeze {
            for body in &window.reply.bodies {
                if let Some(tine) = unit.tines().iter().find(|tine| tine.name == body.body) {
                    self.squeeze_work.push((cycle, tine.pair, body.work));
                }
            }
        }
    }

    fn print(&self, unit: &TampingUnit) {
        let mut sorted = self.iterations.clone();
        sorted.sort_unstable();
        let count = sorted.len();
        let mean = sorted.iter().sum::<u32>() as f64 / count.max(1) as f64;
        let median = sorted.get(count / 2).copied().unwrap_or_default();
        let most = sorted.last().copied().unwrap_or_default();
        let row = |name: &str, value: String| println!("| {name} | {value} |");
        println!("| figure | value |\n|---|---|");
        let depth = format!("depth {:.0} of {:.0} mm", 1e3 * self.depth, 1e3 * unit.travel());
        row("cycle", format!("{}, {depth}", unit.phase()));
        row("peak load pressure of a cylinder", format!("{:.0} bar", self.peak_pressure / 1e5));
        row("peak closing force of a tine in a step", format!("{:.0} N", self.peak_force));
        for squeeze in unit.squeezes() {
            let (closing, pressure) = (1e3 * squeeze.closing, squeeze.pressure / 1e5);
            let mine = |w: &&(usize, usize, f64)| (w.0, w.1) == (squeeze.cycle, squeeze.pair);
            let work: f64 = self.squeeze_work.iter().filter(mine).map(|w| w.2).sum();
            let stop = format!(
                "stop by {} at {:.3} s, {closing:.1} mm and {pressure:.1} bar; work {work:.0} J",
                squeeze.cause, squeeze.time
            );
            row(&format!("cycle {}, pair {}", squeeze.cycle, squeeze.pair), stop);
        }
        self.print_energies(unit);
        row(
            "windows, iterations",
            format!("{count}; median {median}, mean {mean:.1}, largest {most}"),
        );
        row("windows not converged", self.windows_not_converged.to_string());
        let steps = format!("{} of {}", self.steps_not_converged, self.steps);
        row("time steps not converged", steps);
        row("hash of the ballast at the end", self.hash.clone());
    }

    fn print_energies(&self, unit: &TampingUnit) {
        let e = unit.energies();
        let drives = e.pump + e.eccentric_motor + e.lifting;
        let lost = e.valves + e.friction + e.leakage_and_relief;
        let error = drives - e.stored - lost - self.received;
        println!(
            "| work of the drives | {drives:.0} J: pump {:.0}, eccentric motor {:.0}, lifting {:.0} |",
            e.pump, e.eccentric_motor, e.lifting
        );
        println!(
            "| stored and dissipated in the machine | {:.0} J and {lost:.0} J: valves {:.0}, friction {:.0}, \
             leakage and relief {:.0} |",
            e.stored, e.valves, e.friction, e.leakage_and_relief
        );
        println!(
            "| given to the ballast, by the machine and by the ballast | {:.1} J, {:.1} J; by the tines {:.1} J |",
            self.given, self.received, e.tines
        );
        println!("| error of the energy balance | {error:.1} J |");
    }
}

/// Returns the unit above the sleeper of a component.
fn unit(
    description: &ComponentDescription,
    parameters: Parameters,
) -> Result<TampingUnit, Box<dyn Error>> {
    let numbers: BTreeSet<u32> = description.tines.iter().map(|tine| tine.pair).collect();
    let tine = |tine: &TineDescription| Tine {
        name: tine.body.clone(),
        direction: tine.direction,
        pair: numbers.range(..tine.pair).count(),
        start: [tine.start.x, tine.start.y, tine.start.z],
    };
    let tines = description.tines.iter().map(tine).collect();
    let ways = description.tines.iter().map(|tine| tine.start.z - tine.full_depth_z);
    let travel = ways.fold(0.0, f64::max);
    let body = tamped_sleeper(description)?;
    let start = [body.position.x, body.position.y, body.position.z];
    let sleeper = Sleeper { name: body.name.clone(), start };
    let pairs = (0..numbers.len()).collect();
    Ok(TampingUnit::new(tines, sleeper, travel, parameters, vec![pairs]))
}

/// Returns the sleeper that is nearest along the track to all tines.
fn tamped_sleeper(description: &ComponentDescription) -> Result<&BodyDescription, Box<dyn Error>> {
    let sleepers = description.bodies.iter().filter(|body| body.role == "sleeper");
    let nearest = |tine: &TineDescription| {
        let distance = |body: &&BodyDescription| (body.position.x - tine.start.x).abs();
        sleepers.clone().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let mut tamped: Vec<_> = description.tines.iter().filter_map(nearest).collect();
    tamped.dedup_by_key(|body| &body.name);
    match tamped[..] {
        [body] => Ok(body),
        _ => Err(format!("tamped sleepers: expected one, found {}", tamped.len()).into()),
    }
}

/// Tamps until the cycle is done, or for a number of windows.
fn tamp(
    coupling: &mut Coupling<Client, TampingUnit>,
    windows: usize,
) -> Result<RunFigures, Box<dyn Error>> {
    let mut figures = RunFigures::default();
    for number in 1..=windows {
        let begun = (coupling.partner().phase(), coupling.partner().cycle());
        if begun.0 == Phase::Done {
            break;
        }
        let window = coupling.advance()?;
        let unit = coupling.partner();
        figures.add(&window, unit, begun);
        if number % WINDOWS_PER_LINE == 0 {
            print_progress(&window, unit);
        }
    }
    Ok(figures)
}

fn print_progress(window: &Window, unit: &TampingUnit) {
    let Some(row) = unit.trace().last() else { return };
    let largest = |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max);
    println!(
        "{:.3} s  {:10}  depth {:4.0} mm, closing {:4.1} mm, load {:4.0} bar, supply {:3.0} bar, {} iterations",
        window.reply.t1_ns as f64 * 1e-9,
        unit.phase(),
        1e3 * row.depth,
        1e3 * largest(&row.closing),
        largest(&row.load_pressure) / 1e5,
        row.supply / 1e5,
        window.iterations
    );
}

fn main() -> Result<(), Box<dyn Error>> {
    let (values, plain): (Vec<_>, Vec<_>) =
        std::env::args().skip(1).partition(|argument| argument.contains('='));
    let [key, rest @ ..] = &plain[..] else {
        return Err("usage: tamping_unit SITE/ID [WINDOWS] [ENDPOINT] [NAME=VALUE]...".into());
    };
    let mut parameters = Parameters::of_case();
    for (name, value) in values.iter().filter_map(|text| text.split_once('=')) {
        let parameter = parameters.by_name(name);
        *parameter.ok_or(format!(
            "{name}: expected a parameter of the unit, found none of this name"
        ))? = value.parse()?;
    }
    let windows = rest.first().map_or(Ok(usize::MAX), |count| count.parse())?;
    let link = SessionConfig::connect_to(rest.get(1).map_or(DEFAULT_ENDPOINT, |e| e));
    let client = Client::attach(key, &link, "tamping_unit", None, Timeouts::default())?;
    if client.position().now_ns > 0 {
        return Err(format!("{key}: expected a run at its start; serve the case again").into());
    }
    let unit = unit(&client.describe()?, parameters)?;
    let settings = CouplingSettings {
        window_steps: 2,
        tolerance: 2e-6,
        max_iterations: 60,
        ..CouplingSettings::default()
    };
    let mut coupling = Coupling::new(client, unit, settings)?;
    let figures = tamp(&mut coupling, windows)?;
    figures.print(coupling.partner());
    coupling.into_sides().0.detach()?;
    Ok(())
}

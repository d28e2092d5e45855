//! The curves of a run over simulated time.

use crate::plot::{Band, Bars, Chart, Mark};
use crate::source::Source;
use ballast::model::{Norm, Role};
use ballast::track::TampingPhase;
use ballast_session::record::{Column, Row};
use ballast_session::statistics::{MovingMean, norm};
use ballast_session::table::{figure, on_threads};

const TIME: &str = "time (s)";

/// The phases of the cycle along the time axis.
pub fn phases(rows: &[Row]) -> Vec<Band> {
    let mut bands: Vec<(TampingPhase, Band)> = vec![];
    for row in rows {
        let (phase, time) = (row.phase(), row.get(Column::Time));
        match bands.last_mut() {
            Some((last, band)) if *last == phase => band.to = time,
            last => {
                let from = last.map_or(0.0, |(_, band)| band.to);
                bands.push((phase, Band { from, to: time, name: phase.name().into() }));
            }
        }
    }
    bands.into_iter().map(|(_, band)| band).collect()
}

fn over_time(rows: &[Row], value: impl Fn(&Row) -> f64) -> Vec<[f64; 2]> {
    rows.iter().map(|row| [row.get(Column::Time), value(row)]).collect()
}

/// Compactness of each zone.
pub fn compactness(source: &Source, bands: &[Band]) -> Chart {
    let mut chart =
        Chart::new("Compactness of the zones", TIME, "solid / accessible volume").bands(bands);
    for (k, name) in source.summary.setting().zones.iter().enumerate() {
        let points = source.zones.iter().map(|row| [row[0], row[k + 1]]);
        chart = chart.with(name, points.collect(), Mark::Line);
    }
    chart
}

/// Steps over which plotted forces are means: a vibration period, or one where there are fewer than that.
pub fn force_window(source: &Source) -> usize {
    let period = source.summary.setting().period;
    if source.rows.len() < period { 1 } else { period }
}

/// Force on each body of a role, mean over [`force_window`].
pub fn forces(source: &Source, role: Role, title: &str, bands: &[Band]) -> Chart {
    let setting = source.summary.setting();
    let mut chart = Chart::new(title, TIME, "force (kN)").bands(bands).starting_at_zero();
    for (i, followed) in setting.followed.iter().enumerate().filter(|(_, f)| f.role == role) {
        let mut mean = MovingMean::new(force_window(source));
        let points = over_time(&source.rows, |_| 0.0).into_iter().zip(&source.rows);
        let points = points
            .filter_map(|([time, _], row)| Some([time, 1e-3 * norm(mean.take(row.force(i))?)]))
            .collect();
        chart = chart.with(&followed.name, points, Mark::Line);
    }
    chart
}

/// Penetration over grain size.
pub fn penetration(source: &Source, bands: &[Band]) -> Chart {
    let d = source.summary.setting().grain_size;
    let percent = |column| move |row: &Row| 100.0 * row.get(column) / d;
    Chart::new("Penetration", TIME, "over grain size (%)")
        .log_y()
        .bands(bands)
        .with("largest", over_time(&source.rows, percent(Column::MaxPenetration)), Mark::Line)
        .with("mean", over_time(&source.rows, percent(Column::MeanPenetration)), Mark::Line)
}

/// What a norm is called.
pub fn norm_name(norm: Norm) -> &'static str {
    match norm {
        Norm::Qm16 => "QM/16",
        Norm::Quad => "Quad",
        Norm::NaturalMap => "natural map",
    }
}

/// Residual of each step in the norm that the case judges by, and what was asked for.
pub fn residual(source: &Source, bands: &[Band]) -> Chart {
    let norm = source.model.solver.norm;
    let reached: fn(&Row) -> f64 = match norm {
        Norm::Qm16 => Row::qm16,
        Norm::Quad => |row| row.get(Column::Quad),
        Norm::NaturalMap => |row| row.get(Column::NaturalMap),
    };
    let title = format!("Residual of each step ({})", norm_name(norm));
    let chart = Chart::new(&title, TIME, "residual").log_y().bands(bands).with(
        "reached",
        over_time(&source.rows, reached),
        Mark::Line,
    );
    match (source.model.solver.tolerance, source.rows.last()) {
        (Some(tolerance), Some(last)) => {
            let ends = [0.0, last.get(Column::Time)].map(|time| [time, tolerance]);
            chart.with("asked for", ends.to_vec(), Mark::Expected)
        }
        _ => chart,
    }
}

pub fn iterations(source: &Source, bands: &[Band]) -> Chart {
    Chart::new("Iterations of each step, all attempts at it", TIME, "iterations")
        .bands(bands)
        .starting_at_zero()
        .with("iterations", over_time(&source.rows, |row| row.get(Column::Iterations)), Mark::Line)
}

pub fn coordination(source: &Source, bands: &[Band]) -> Chart {
    Chart::new("Coordination", TIME, "touching neighbours per grain")
        .bands(bands)
        .starting_at_zero()
        .with("mean", over_time(&source.rows, |row| row.get(Column::Coordination)), Mark::Line)
}

/// The ledger of the grains' energy: what passes through, and what is left of it.
pub fn energy(source: &Source, bands: &[Band]) -> [Chart; 2] {
    let start = source.state.energy.initial_potential;
    let of = |column| over_time(&source.rows, move |row: &Row| row.get(column));
    let potential = over_time(&source.rows, |row| row.get(Column::Potential) - start);
    let chart = |title| Chart::new(title, TIME, "energy (J)").bands(bands);
    [
        chart("Work of tools and walls, and what contacts took")
            .with("work on the grains", of(Column::WorkIn), Mark::Line)
            // The two are nearly one.
            .with("dissipated", of(Column::Dissipated), Mark::Dashed),
        chart("Energy of the grains")
            .with("kinetic", of(Column::Kinetic), Mark::Line)
            .with("potential, change since the start", potential, Mark::Line)
            .with("balance error", of(Column::BalanceError), Mark::Line),
    ]
}

/// Wall time per phase of the step; `None` where the run did not end.
pub fn profile(source: &Source) -> Option<Bars> {
    let timing = source.timing.as_ref()?;
    let phases = timing["phases"].as_object()?;
    let wall = |name: &str| phases.get(name).and_then(|p| p["wall_s"].as_f64());
    let names = ballast::step::Phase::ALL.iter().map(|phase| phase.name()).chain(["output"]);
    // Without phases that the case does not ask for.
    let spent = names.filter_map(|name| Some((name, wall(name)?))).filter(|s| s.1 > 0.0);
    let spent: Vec<(&str, f64)> = spent.collect();
    let whole: f64 = spent.iter().map(|s| s.1).sum();
    let said = |s: f64| format!("{} s, {:.1} %", figure(s, 3), 100.0 * s / whole.max(1e-9));
    let title = format!(
        "Wall time, {}, from step {}: {} s",
        on_threads(timing["threads"].as_u64().unwrap_or(0) as usize),
        timing["from_step"],
        figure(whole, 3)
    );
    let bars = spent.into_iter().map(|(name, s)| (name.to_string(), s, said(s))).collect();
    Some(Bars { title, bars })
}

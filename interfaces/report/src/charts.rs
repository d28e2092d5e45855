//! Charts of a run over simulated time.

use crate::plot::{BarChart, Chart, ChartBand, SeriesStyle};
use crate::source::ReportSource;
use ballast::model::{Norm, Role};
use ballast::track::TampingPhase;
use ballast_session::record::{Column, StepRow};
use ballast_session::statistics::{MovingMean, norm};
use ballast_session::table::{figure, on_threads};

const TIME: &str = "time (s)";

/// Returns the phases of the cycle as bands of the time axis.
pub fn phases(rows: &[StepRow]) -> Vec<ChartBand> {
    let mut bands: Vec<(TampingPhase, ChartBand)> = vec![];
    for row in rows {
        let (phase, time) = (row.phase(), row.get(Column::Time));
        match bands.last_mut() {
            Some((last, band)) if *last == phase => band.to = time,
            last => {
                let from = last.map_or(0.0, |(_, band)| band.to);
                bands.push((phase, ChartBand { from, to: time, name: phase.name().into() }));
            }
        }
    }
    bands.into_iter().map(|(_, band)| band).collect()
}

fn over_time(rows: &[StepRow], value: impl Fn(&StepRow) -> f64) -> Vec<[f64; 2]> {
    rows.iter().map(|row| [row.get(Column::Time), value(row)]).collect()
}

/// Charts the compactness of the zones: under the sleepers, of the cribs, where tines pass; charts without a zone are left out.
pub fn compactness(source: &ReportSource, bands: &[ChartBand]) -> Vec<Chart> {
    let zones = &source.summary.settings().zones;
    let groups = [
        ("under", "Compactness under the sleepers"),
        ("crib", "Compactness of the cribs"),
        ("insertion", "Compactness where the tines pass"),
    ];
    let has_zone = |(start, _): &(&str, &str)| zones.iter().any(|name| name.starts_with(start));
    let chart = |(start, title)| {
        let empty = Chart::new(title, TIME, "solid / accessible volume").bands(bands);
        let group = zones.iter().enumerate().filter(|(_, name)| name.starts_with(start));
        group.fold(empty, |chart, (k, name)| {
            let points = source.zones.iter().map(|row| [row[0], row[k + 1]]);
            chart.with(name, points.collect(), SeriesStyle::Line)
        })
    };
    groups.into_iter().filter(has_zone).map(chart).collect()
}

/// Returns the number of steps over which forces are averaged: a vibration period, or 1 if the run is shorter.
pub fn force_window(source: &ReportSource) -> usize {
    let period = source.summary.settings().period;
    if source.rows.len() < period { 1 } else { period }
}

/// Charts the force on each body of a role, averaged over [`force_window`] steps.
pub fn forces(source: &ReportSource, role: Role, title: &str, bands: &[ChartBand]) -> Chart {
    let setting = source.summary.settings();
    let mut chart = Chart::new(title, TIME, "force (kN)").bands(bands).starting_at_zero();
    for (i, tracked) in setting.tracked.iter().enumerate().filter(|(_, f)| f.role == role) {
        let mut mean = MovingMean::new(force_window(source));
        let points = over_time(&source.rows, |_| 0.0).into_iter().zip(&source.rows);
        let points = points
            .filter_map(|([time, _], row)| Some([time, 1e-3 * norm(mean.take(row.force(i))?)]))
            .collect();
        chart = chart.with(&tracked.name, points, SeriesStyle::Line);
    }
    chart
}

/// Charts penetrations over the grain size.
pub fn penetration(source: &ReportSource, bands: &[ChartBand]) -> Chart {
    let d = source.summary.settings().grain_size;
    let percent = |column| move |row: &StepRow| 100.0 * row.get(column) / d;
    Chart::new("Penetration", TIME, "over grain size (%)")
        .log_y()
        .bands(bands)
        .with(
            "largest",
            over_time(&source.rows, percent(Column::MaxPenetration)),
            SeriesStyle::Line,
        )
        .with("mean", over_time(&source.rows, percent(Column::MeanPenetration)), SeriesStyle::Line)
}

/// Returns the name of a norm.
pub fn norm_name(norm: Norm) -> &'static str {
    match norm {
        Norm::Qm16 => "QM/16",
        Norm::Quad => "Quad",
        Norm::NaturalMap => "natural map",
    }
}

/// Charts the residual of each step in the norm of the case, with the tolerance.
pub fn residual(source: &ReportSource, bands: &[ChartBand]) -> Chart {
    let norm = source.model.solver.norm;
    let reached: fn(&StepRow) -> f64 = match norm {
        Norm::Qm16 => StepRow::qm16,
        Norm::Quad => |row| row.get(Column::ResidualQuad),
        Norm::NaturalMap => |row| row.get(Column::ResidualNaturalMap),
    };
    let title = format!("Residual of each step ({})", norm_name(norm));
    let chart = Chart::new(&title, TIME, "residual").log_y().bands(bands).with(
        "reached",
        over_time(&source.rows, reached),
        SeriesStyle::Line,
    );
    match (source.model.solver.tolerance, source.rows.last()) {
        (Some(tolerance), Some(last)) => {
            let ends = [0.0, last.get(Column::Time)].map(|time| [time, tolerance]);
            chart.with("tolerance", ends.to_vec(), SeriesStyle::Expected)
        }
        _ => chart,
    }
}

pub fn iterations(source: &ReportSource, bands: &[ChartBand]) -> Chart {
    Chart::new("Iterations of each step, all passes", TIME, "iterations")
        .bands(bands)
        .starting_at_zero()
        .with(
            "iterations",
            over_time(&source.rows, |row| row.get(Column::Iterations)),
            SeriesStyle::Line,
        )
}

pub fn coordination(source: &ReportSource, bands: &[ChartBand]) -> Chart {
    Chart::new("Coordination", TIME, "touching neighbours per grain")
        .bands(bands)
        .starting_at_zero()
        .with(
            "mean",
            over_time(&source.rows, |row| row.get(Column::Coordination)),
            SeriesStyle::Line,
        )
}

/// Charts the energy ledger: work and dissipation, and energies of the grains.
pub fn energy(source: &ReportSource, bands: &[ChartBand]) -> [Chart; 2] {
    let start = source.state.energy.initial_potential;
    let of = |column| over_time(&source.rows, move |row: &StepRow| row.get(column));
    let potential = over_time(&source.rows, |row| row.get(Column::Potential) - start);
    let chart = |title| Chart::new(title, TIME, "energy (J)").bands(bands);
    [
        chart("External work and dissipated energy")
            .with("external work", of(Column::ExternalWork), SeriesStyle::Line)
            // The two are nearly one.
            .with("dissipated", of(Column::Dissipated), SeriesStyle::Dashed),
        chart("Energy of the grains")
            .with("kinetic", of(Column::Kinetic), SeriesStyle::Line)
            .with("potential, change since the start", potential, SeriesStyle::Line)
            .with("springs of the contacts", of(Column::Elastic), SeriesStyle::Line)
            .with("balance error", of(Column::BalanceError), SeriesStyle::Line),
    ]
}

/// Charts the wall time per phase of the step; `None` if the run has not ended.
pub fn profile(source: &ReportSource) -> Option<BarChart> {
    let timing = source.timing.as_ref()?;
    let phases = timing["phases"].as_object()?;
    let wall = |name: &str| phases.get(name).and_then(|p| p["wall_s"].as_f64());
    let names = ballast::step::Phase::ALL.iter().map(|phase| phase.name()).chain(["output"]);
    // Without phases that the case does not ask for.
    let spent = names.filter_map(|name| Some((name, wall(name)?))).filter(|s| s.1 > 0.0);
    let spent: Vec<(&str, f64)> = spent.collect();
    let whole: f64 = spent.iter().map(|s| s.1).sum();
    let text = |s: f64| format!("{} s, {:.1} %", figure(s, 3), 100.0 * s / whole.max(1e-9));
    let title = format!(
        "Wall time, {}, from step {}: {} s",
        on_threads(timing["threads"].as_u64().unwrap_or(0) as usize),
        timing["from_step"],
        figure(whole, 3)
    );
    let bars = spent.into_iter().map(|(name, s)| (name.to_string(), s, text(s))).collect();
    Some(BarChart { title, bars })
}

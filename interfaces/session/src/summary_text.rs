//! The final summary for people.

use crate::files::RunFiles;
use crate::profile::Profile;
use crate::record::Column;
use crate::summary::{BodyFigures, Moment, Summary};
use crate::table::{Table, duration, figure};
use ballast::model::Role;
use std::path::Path;

/// What is said of convergence where none was asked for.
pub const NO_TOLERANCE: &str = "no tolerance asked for";
/// How far a tine may stay above its depth without a word, m: what its mount gives way.
const SHORT: f64 = 1e-3;

/// The summary as a text of several tables.
pub fn text(summary: &Summary) -> String {
    let tables = tables(summary);
    let sections: Vec<String> =
        tables.iter().map(Table::text).filter(|text| !text.is_empty()).collect();
    sections.join("\n")
}

/// The figures of a run, subject by subject; tables of what the run does not have are empty.
pub fn tables(summary: &Summary) -> [Table; 6] {
    [
        compactness(summary),
        coordination(summary),
        forces(summary, Role::Tine, "force on tine (N)"),
        forces(summary, Role::Sleeper, "force on sleeper (N)"),
        energy(summary),
        quality(summary),
    ]
}

fn compactness(summary: &Summary) -> Table {
    let mut table = Table::new("compactness", ["before", "after", "change"]);
    for (name, [before, after]) in summary.setting().zones.iter().zip(&summary.compactness) {
        let change = change(*before, *after);
        let told = |value: f64| if value.is_nan() { "-".into() } else { format!("{value:.4}") };
        table.row([name.clone(), told(*before), told(*after), change]);
    }
    table
}

/// How much a figure has grown over what it was.
pub fn change(before: f64, after: f64) -> String {
    let percent = 100.0 * (after - before) / before;
    match percent {
        p if !p.is_finite() => "-".into(),
        // What rounds to nothing has no sign.
        p if p.abs() < 0.05 => "0.0 %".into(),
        p => format!("{p:+.1} %"),
    }
}

fn coordination(summary: &Summary) -> Table {
    let mut table = Table::new("coordination", ["touching neighbours", "at (s)", "phase"]);
    if let Some(moments) = &summary.coordination {
        for (label, Moment { value, time, phase }) in
            ["start", "minimum", "end"].iter().zip(moments)
        {
            table.row([
                label.to_string(),
                format!("{value:.2}"),
                format!("{time:.4}"),
                phase.name().into(),
            ]);
        }
    }
    table
}

fn forces(summary: &Summary, role: Role, title: &str) -> Table {
    let mut table = Table::new(
        title,
        [
            "peak",
            "at (s)",
            "phase",
            "peak, period mean",
            "insertion: mean size",
            "squeeze: mean size",
            "squeeze: peak, period mean",
            "work (J)",
            "lowest (m)",
        ],
    );
    let bodies = summary.setting().followed.iter().zip(&summary.bodies);
    for (followed, body) in bodies.filter(|(followed, _)| followed.role == role) {
        let BodyFigures { peak, period_peak, insertion, squeeze, work, lowest, .. } = body;
        let Some(Moment { value, time, phase }) = peak else { continue };
        let told = |force: Option<f64>| force.map_or("-".into(), |force| figure(force, 4));
        table.row([
            followed.name.clone(),
            figure(*value, 4),
            format!("{time:.4}"),
            phase.name().into(),
            told(*period_peak),
            told(insertion.mean_size()),
            told(squeeze.mean_size()),
            told(squeeze.period_peak),
            figure(*work, 4),
            format!("{lowest:.4}"),
        ]);
    }
    table
}

fn energy(summary: &Summary) -> Table {
    let mut table = Table::new("energy of the grains", ["J"]);
    if let Some(last) = summary.last() {
        for (label, column) in [
            ("kinetic", Column::Kinetic),
            ("potential", Column::Potential),
            ("work done on them", Column::WorkIn),
            ("dissipated", Column::Dissipated),
            ("balance error", Column::BalanceError),
        ] {
            table.row([label.to_string(), figure(last.get(column), 4)]);
        }
        let label = "created, in steps whose contacts gave more than they took";
        table.row([label.to_string(), figure(summary.created, 4)]);
    }
    table
}

fn quality(summary: &Summary) -> Table {
    let mut table = Table::new("quality", ["mean", "max"]);
    if summary.steps == 0 {
        return table;
    }
    let d = summary.setting().grain_size;
    let percent = |value: f64| format!("{} %", figure(100.0 * value / d, 3));
    table.row([
        format!("penetration over d = {:.1} mm", 1e3 * d),
        percent(summary.mean_penetration.mean()),
        percent(summary.max_penetration.max()),
    ]);
    for (label, statistics) in [
        ("residual (QM/16)", summary.residual),
        ("residual (natural map)", summary.natural_map),
        ("iterations per step, all attempts", summary.iterations),
        ("contacts", summary.contacts),
        ("contacts that carry", summary.active_contacts),
        ("contacts of the interface", summary.interface_contacts),
        ("subdomains", summary.subdomains),
    ] {
        let cells = [label.into(), figure(statistics.mean(), 3), figure(statistics.max(), 3)];
        table.row(cells);
    }
    let not_converged = summary.not_converged();
    let not_converged =
        not_converged.map_or(NO_TOLERANCE.into(), |steps| format!("{steps} of {}", summary.steps));
    table.row(["steps not converged", "", &not_converged]);
    for (label, ways) in [
        ("tines short of the depth asked for", summary.short_of_depth()),
        ("tines short of the closing asked for", summary.short_of_closing()),
    ] {
        let short: Vec<f64> = ways.iter().copied().filter(|by| *by > SHORT).collect();
        if !short.is_empty() {
            let most = 1e3 * short.iter().copied().fold(0.0, f64::max);
            let told = format!("{} of {}, by {most:.1} mm", short.len(), ways.len());
            table.row([label, "", &told]);
        }
    }
    if let Some(lost) = summary.lost {
        table.row(["grains lost", "", &lost.to_string()]);
    }
    if summary.repeated > 0 {
        table.row(["steps done again for what they overlooked", "", &summary.repeated.to_string()]);
    }
    if summary.guarded > 0 {
        table.row(["steps repeated with the guard", "", &summary.guarded.to_string()]);
    }
    table
}

/// Where the time of `steps` steps went.
pub fn profile(profile: &Profile, steps: u64) -> String {
    let mut table =
        Table::new("phase of the step", ["wall (s)", "share", "CPU (s)", "ms per step"]);
    let whole: f64 = profile.lines().map(|(_, spent)| spent.wall.as_secs_f64()).sum();
    // Without phases that the case does not ask for.
    for (name, spent) in profile.lines().filter(|(_, spent)| !spent.wall.is_zero()) {
        let wall = spent.wall.as_secs_f64();
        table.row([
            name.to_string(),
            format!("{wall:.3}"),
            format!("{:.1} %", 100.0 * wall / whole.max(1e-9)),
            format!("{:.3}", spent.cpu.as_secs_f64()),
            format!("{:.3}", 1e3 * wall / steps.max(1) as f64),
        ]);
    }
    format!("{}in all {}\n", table.text(), duration(std::time::Duration::from_secs_f64(whole)))
}

/// Where the run's files are and what to look at; `frames`: whether the results hold geometry.
pub fn pointers(
    files: &RunFiles,
    frames: bool,
    resumable: bool,
    recording: Option<&Path>,
) -> String {
    let mut text = String::from("files\n");
    let checkpoint =
        resumable.then(|| (files.checkpoint(), "the last state; `ballast resume` goes on from it"));
    let recording = recording.map(|path| {
        (path.to_owned(), "the recording; viewers of MCAP open it, `ballast replay` runs it again")
    });
    let results = if frames {
        "open it in ParaView; `ballast export` makes tables and shapes of it"
    } else {
        "tables only, which `ballast export` writes as CSV; `output_interval_s` above 0 in [run] asks for frames"
    };
    let always = [(files.results(), results), (files.summary(), "these figures, for programs")];
    for (path, what) in always.into_iter().chain(checkpoint).chain(recording) {
        text += &format!("  {}\n      {what}\n", path.display());
    }
    text
}

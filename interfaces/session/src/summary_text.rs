//! Summary of a run as text.

use crate::profile::Profile;
use crate::quantities::Quantity as Q;
use crate::record::Column;
use crate::run_files::RunFiles;
use crate::summary::{BodySummary, RunSummary, TimedValue, last_cycle};
use crate::table::{TextTable, duration, figure};
use ballast::model::Role;
use ballast::track::TampingPhase;
use std::path::Path;

/// Text in the place of a count of steps that have not converged, without a tolerance.
pub const NO_TOLERANCE: &str = "no tolerance set";
/// Distance to a target that is not reported, m: deflection of a mount.
const TARGET_TOLERANCE_M: f64 = 1e-3;

/// Returns a warning of a tine that ended more than a mean grain size above its depth; `None` if there is none.
pub fn tine_depth_warning(summary: &RunSummary) -> Option<String> {
    let above = summary.depth_shortfalls().into_iter().fold(0.0, f64::max);
    (above > summary.settings().grain_size).then(|| {
        format!(
            "a tine ended {:.0} mm above its depth: jammed, or held by `tamping.insertion.force_limit_N`",
            1e3 * above
        )
    })
}

/// Returns the summary as a text of several tables.
pub fn text(summary: &RunSummary) -> String {
    let tables = tables(summary);
    let sections: Vec<String> =
        tables.iter().map(TextTable::text).filter(|text| !text.is_empty()).collect();
    sections.join("\n")
}

/// Returns the tables of the summary; tables without figures are empty.
pub fn tables(summary: &RunSummary) -> [TextTable; 8] {
    [
        compactness(summary),
        coordination(summary),
        forces(summary, Role::Tine, "force on tine (N)"),
        forces(summary, Role::Sleeper, "force on sleeper (N)"),
        forces(summary, Role::Plate, "force on plate (N)"),
        settlement(summary),
        energy(summary),
        quality(summary),
    ]
}

fn compactness(summary: &RunSummary) -> TextTable {
    let mut table = TextTable::new(Q::Compactness.label(), ["before", "after", "change"]);
    for (name, [before, after]) in summary.settings().zones.iter().zip(&summary.compactness) {
        let change = change(*before, *after);
        let text = |value: f64| if value.is_nan() { "-".into() } else { format!("{value:.4}") };
        table.row([name.clone(), text(*before), text(*after), change]);
    }
    table
}

/// Returns the relative change of a figure, as text.
pub fn change(before: f64, after: f64) -> String {
    let percent = 100.0 * (after - before) / before;
    match percent {
        p if !p.is_finite() => "-".into(),
        // No sign if it rounds to zero.
        p if p.abs() < 0.05 => "0.0 %".into(),
        p => format!("{p:+.1} %"),
    }
}

fn coordination(summary: &RunSummary) -> TextTable {
    let mut table = TextTable::new("coordination", [Q::Coordination.label(), "at (s)", "phase"]);
    if let Some(moments) = &summary.coordination {
        for (label, TimedValue { value, time, phase }) in
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

fn forces(summary: &RunSummary, role: Role, title: &str) -> TextTable {
    let mut table = TextTable::new(
        title,
        [
            Q::PeakForce.label().to_string(),
            "at (s)".into(),
            Q::Phase.label().into(),
            Q::PeakPeriodAveragedForce.label().into(),
            format!("insertion: {}", Q::MeanForceMagnitude.label()),
            format!("squeeze: {}", Q::MeanForceMagnitude.label()),
            format!("squeeze: {}", Q::PeakPeriodAveragedForce.label()),
            Q::Work.label().into(),
            Q::MinZ.label().into(),
        ],
    );
    let bodies = summary.settings().tracked.iter().zip(&summary.bodies);
    for (tracked, body) in bodies.filter(|(tracked, _)| tracked.role == role) {
        let BodySummary { peak, period_peak, insertion, squeeze, work, min_z, .. } = body;
        let Some(TimedValue { value, time, phase }) = peak else { continue };
        let text = |force: Option<f64>| force.map_or("-".into(), |force| figure(force, 4));
        table.row([
            tracked.name.clone(),
            figure(*value, 4),
            format!("{time:.4}"),
            phase.name().into(),
            text(*period_peak),
            text(insertion.mean_magnitude()),
            text(squeeze.mean_magnitude()),
            text(squeeze.period_peak),
            figure(*work, 4),
            format!("{min_z:.4}"),
        ]);
    }
    table
}

fn settlement(summary: &RunSummary) -> TextTable {
    let title = format!("{} (mm)", Q::TrafficSettlement.label());
    let mut table = TextTable::new(&title, ["first cycle", "last cycle", "all cycles"]);
    let bodies = summary.settings().tracked.iter().zip(&summary.bodies);
    for (tracked, body) in bodies.filter(|(tracked, _)| tracked.role == Role::Sleeper) {
        let settlements = body.traffic_settlements();
        let (Some(first), Some(all)) = (settlements.first(), settlements.last()) else { continue };
        let cells = [*first, last_cycle(&settlements), *all].map(|m| format!("{:.2}", 1e3 * m));
        table.row(std::iter::once(tracked.name.clone()).chain(cells));
    }
    table
}

fn energy(summary: &RunSummary) -> TextTable {
    let mut table = TextTable::new("energy of the grains", ["J"]);
    if let Some(last) = summary.last() {
        for (quantity, column) in [
            (Q::Kinetic, Column::Kinetic),
            (Q::Potential, Column::Potential),
            (Q::Elastic, Column::Elastic),
            (Q::ExternalWork, Column::ExternalWork),
            (Q::Dissipated, Column::Dissipated),
            (Q::BalanceError, Column::BalanceError),
        ] {
            table.row([quantity.label().to_string(), figure(last.get(column), 4)]);
        }
        let work = summary.total_contact_work();
        for (quantity, joules) in [
            (Q::SpuriousContactEnergy, summary.spurious_contact_energy),
            (Q::ComplementarityGap, work.gap),
            (Q::InfeasibleWork, work.infeasible),
        ] {
            table.row([quantity.label().to_string(), figure(joules, 4)]);
        }
    }
    table
}

fn quality(summary: &RunSummary) -> TextTable {
    let mut table = TextTable::new("quality", ["mean", "max"]);
    if summary.steps == 0 {
        return table;
    }
    let d = summary.settings().grain_size;
    let percent = |value: f64| format!("{} %", figure(100.0 * value / d, 3));
    table.row([
        format!("penetration over d = {:.1} mm", 1e3 * d),
        percent(summary.mean_penetration.mean()),
        percent(summary.max_penetration.max()),
    ]);
    if let Some(error) = summary.force_error() {
        table.row([Q::ForceError.label(), &format!("{:.2} %", 100.0 * error), ""]);
    }
    if let Some(error) = summary.total_contact_work().error() {
        let phases = [TampingPhase::Insertion, TampingPhase::Squeeze].into_iter();
        let phases = phases.filter_map(|phase| {
            let error = summary.contact_work[phase as usize].error()?;
            Some(format!("{}: {:.2} %", phase.name(), 100.0 * error))
        });
        let phases = phases.collect::<Vec<_>>().join(", ");
        table.row([Q::ComplementarityError.label(), &format!("{:.2} %", 100.0 * error), &phases]);
    }
    for (quantity, statistics) in [
        (Q::ResidualQm16, summary.residual),
        (Q::ResidualNaturalMap, summary.natural_map),
        (Q::Iterations, summary.iterations),
        (Q::Contacts, summary.contacts),
        (Q::ActiveContacts, summary.active_contacts),
        (Q::InterfaceContacts, summary.interface_contacts),
        (Q::Subdomains, summary.subdomains),
    ] {
        let label = quantity.label().to_string();
        let cells = [label, figure(statistics.mean(), 3), figure(statistics.max(), 3)];
        table.row(cells);
    }
    let not_converged = summary.not_converged();
    let not_converged =
        not_converged.map_or(NO_TOLERANCE.into(), |steps| format!("{steps} of {}", summary.steps));
    table.row([Q::StepsNotConverged.label(), "", &not_converged]);
    for (quantity, shortfalls) in [
        (Q::TinesBelowTargetDepth, summary.depth_shortfalls()),
        (Q::TinesBelowTargetClosing, summary.closing_shortfalls()),
    ] {
        let below = shortfalls.iter().copied().filter(|by| *by > TARGET_TOLERANCE_M);
        let (count, max) = below.fold((0, 0.0), |(n, max), by| (n + 1, f64::max(max, by)));
        if count > 0 {
            let text = format!("{count} of {}, by {:.1} mm", shortfalls.len(), 1e3 * max);
            table.row([quantity.label(), "", &text]);
        }
    }
    if let Some(lost) = summary.lost {
        table.row([Q::GrainsLost.label(), "", &lost.to_string()]);
    }
    if let Some(share) = summary.open_impulse_share() {
        table.row([Q::OpenImpulseShare.label(), "", &format!("{:.2} %", 100.0 * share)]);
    }
    for (quantity, count) in [
        (Q::StepsResolved, summary.resolved),
        (Q::SyncFallback, summary.sync_fallback),
        (Q::LimitedRotations, summary.limited_rotations),
    ] {
        if count > 0 {
            table.row([quantity.label(), "", &count.to_string()]);
        }
    }
    table
}

/// Returns the table of wall and CPU time per phase of `steps` steps.
pub fn profile(profile: &Profile, steps: u64) -> String {
    let mut table =
        TextTable::new("phase of the step", ["wall (s)", "share", "CPU (s)", "ms per step"]);
    let whole: f64 = profile.lines().map(|(_, spent)| spent.wall.as_secs_f64()).sum();
    // Phases that the case does not use are left out.
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
    format!("{}total {}\n", table.text(), duration(std::time::Duration::from_secs_f64(whole)))
}

/// Returns the list of the files of a run; `frames` is true if the results contain geometry.
pub fn pointers(
    files: &RunFiles,
    frames: bool,
    resumable: bool,
    recording: Option<&Path>,
) -> String {
    let mut text = String::from("files\n");
    let checkpoint =
        resumable.then(|| (files.checkpoint(), "last state; `ballast resume` continues from it"));
    let recording = recording.map(|path| {
        (path.to_owned(), "recording; MCAP viewers open it, `ballast replay` replays it")
    });
    let results = if frames {
        "results; open in ParaView, or export tables and shapes with `ballast export`"
    } else {
        "tables only; `output_interval_s` above 0 in [run] adds frames; `ballast export` writes CSV"
    };
    let always = [(files.results(), results), (files.summary(), "these figures as JSON")];
    for (path, what) in always.into_iter().chain(checkpoint).chain(recording) {
        text += &format!("  {}\n      {what}\n", path.display());
    }
    text
}

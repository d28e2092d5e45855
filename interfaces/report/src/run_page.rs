//! Report of a run: one page from the files of the run.
//!
//! Reads: results, checkpoint and summary of a run. Writes: a page. Contract: the page is a function of these files; all
//! figures were measured by the run or are measured here on its states.

use crate::charts;
use crate::maps::CompactnessGrid;
use crate::plot::{Chart, HtmlPage, Legend, SeriesStyle};
use crate::scene_view::SceneView;
use crate::section::SectionPicture;
use crate::source::ReportSource;
use crate::squeezes::squeezes;
use ballast::math::{Pose, Vec3};
use ballast::model::{PartitionRule, Role, Solver};
use ballast::observe::{MIN_CONTACT_FORCE, SqueezeOutcome};
use ballast::track::TampingPhase;
use ballast_session::record::Column;
use ballast_session::summary_text;
use ballast_session::table::{TextTable, figure};
use ballast_session::{Failure, Result};

/// Returns the report of a run, with a 3D view of its frames on request.
///
/// # Errors
/// A table of steps that does not fit the case; a 3D view of a run without frames.
pub fn page(source: &ReportSource, with_scene: bool) -> Result<HtmlPage> {
    let plan = &source.case.plan;
    let tracked = &source.summary.settings().tracked;
    let squeezes = squeezes(plan, &source.model, tracked, &source.rows)?;
    let mut page = HtmlPage::new(&format!("Tamping of {}", plan.name));
    introduction(source, &mut page);
    pictures(source, &mut page);
    if with_scene {
        scene(source, &mut page)?;
    }
    compactness(source, &mut page);
    forces(source, &squeezes, &mut page);
    quality(source, &mut page);
    energy(source, &mut page);
    profile(source, &mut page);
    provenance(source, &mut page);
    Ok(page)
}

fn period(source: &ReportSource) -> usize {
    source.summary.settings().period
}

fn introduction(source: &ReportSource, page: &mut HtmlPage) {
    let (summary, steps) = (&source.summary, source.case.steps());
    let time = summary.last().map_or(0.0, |row| row.get(Column::Time));
    page.text(&format!(
        "{} grains, {} of {steps} steps of {} ms, {time:.4} s of simulated time.",
        source.model.grains.len(),
        summary.steps,
        figure(1e3 * source.model.stepping.h(), 3)
    ));
    if summary.steps < steps {
        let beyond = match source.beyond {
            0 => String::new(),
            steps => format!(
                " {steps} further recorded steps are omitted; a resumed run computes them again."
            ),
        };
        page.text(&format!(
            "This run is unfinished: the report ends at its last checkpoint.{beyond}"
        ));
    }
    let mut cards = Vec::new();
    let zones = summary.settings().zones.iter().zip(&summary.compactness);
    // A zone is under a block of a sleeper, or under the sleeper.
    let is_under_tamped = |zone: &str| {
        let sleeper = zone.split('/').nth(1);
        let tamped = source.case.plan.sleepers.iter().filter(|sleeper| sleeper.tamped);
        zone.starts_with("under") && tamped.map(|s| &s.name[..]).any(|name| sleeper == Some(name))
    };
    for (name, [before, after]) in zones.filter(|(name, _)| is_under_tamped(name)) {
        let note = format!("{before:.3} before, {}", summary_text::change(*before, *after));
        cards.push([format!("compactness {name}"), format!("{after:.3}"), note]);
    }
    let tines = summary.settings().tracked.iter().zip(&summary.bodies);
    let peak = tines
        .filter(|(f, _)| f.role == Role::Tine)
        .filter_map(|(tine, figures)| Some((tine, figures.period_peak?)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        // Without contact of a tine.
        .filter(|(_, force)| *force > 0.0);
    if let Some((tine, force)) = peak {
        let value = format!("{} kN", figure(1e-3 * force, 3));
        cards.push(["largest tine force".into(), value, format!("{}, period-averaged", tine.name)]);
    }
    let percent =
        |value: f64| format!("{} %", figure(100.0 * value / summary.settings().grain_size, 2));
    let largest = format!("maximum {}; targets 0.1 %, 5 %", percent(summary.max_penetration.max()));
    cards.push(["mean penetration / d".into(), percent(summary.mean_penetration.mean()), largest]);
    let error = summary.force_error().map_or("-".into(), |e| format!("{:.2} %", 100.0 * e));
    let method = "difference of two solutions of the same steps; target 1 %".into();
    cards.push(["error of tool and sleeper forces".into(), error, method]);
    let work = summary.total_contact_work();
    let error = work.error().map_or("-".into(), |e| format!("{:.2} %", 100.0 * e));
    let parts = [work.gap + work.infeasible, work.dissipated].map(|joules| figure(joules, 3));
    let joules = format!("{} of {} J, all steps", parts[0], parts[1]);
    cards.push(["complementarity gap / dissipated energy".into(), error, joules]);
    page.cards(&cards);
}

fn tolerance(solver: &Solver) -> String {
    solver.tolerance.map_or("none: all iterations".into(), |t| {
        format!("{t:e} ({})", charts::norm_name(solver.norm))
    })
}

/// Returns the plane of the pictures, m: through a tine, else a sleeper, else the middle.
fn plane(source: &ReportSource) -> f64 {
    let plan = &source.case.plan;
    let tine = plan.tines.first().map(|tine| tine.position[1]);
    let sleeper = plan.sleepers.first().map(|sleeper| sleeper.centre[1]);
    tine.or(sleeper).unwrap_or(0.5 * plan.bed.size.y)
}

/// Returns the displacement of each grain since the first frame `[ng]`, mm.
fn displacements(source: &ReportSource, first: &[Pose]) -> Vec<f64> {
    let last = &source.state.position[..source.model.grains.len()];
    last.iter().zip(first).map(|(p, q)| 1e3 * (p - q.position).norm()).collect()
}

/// Returns the displacement that nine tenths of the grains stay below, mm.
///
/// One grain thrown out of the bed must not hide the displacements of all others.
fn large_displacement(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() * 9 / 10).copied().unwrap_or(1.0).max(1e-3)
}

fn last_poses(source: &ReportSource) -> Vec<Pose> {
    (0..source.model.body_count()).map(|b| source.state.pose(b)).collect()
}

fn pictures(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("The bed");
    let Some(first) = source.frames.first() else {
        page.note("No pictures: the case has no frames (run.output_interval_s = 0).");
        return;
    };
    let values = displacements(source, &first.poses);
    let high = large_displacement(&values);
    let legend =
        Legend { low: 0.0, high, label: "displacement of the grain, start to end (mm)".into() };
    let bed = &source.case.plan.bed;
    let section = SectionPicture {
        model: &source.model,
        y: plane(source),
        low: [0.0, 0.0],
        high: [bed.size.x, picture_top(source)],
        values: &values,
        unit: "mm",
        legend: &legend,
    };
    let mut drawings = vec![section.picture("Before", &first.poses)];
    if let Some((title, frame)) = source.end_of(TampingPhase::Squeeze) {
        drawings.push(section.picture(&title, &frame.poses));
    }
    drawings.push(section.picture("End", &last_poses(source)));
    page.figures(&drawings);
    page.note(&format!(
        "Vertical section along the track at y = {} m through the true polyhedra; sleeper and tines as solids. Grains \
         that seem to float rest on others outside the plane. A tenth of the grains moved farther than the last shade.",
        figure(section.y, 3)
    ));
}

/// Adds the 3D view of the frames.
fn scene(source: &ReportSource, page: &mut HtmlPage) -> Result<()> {
    let Some(first) = source.frames.first() else {
        return Err(Failure::Failed(
            "--scene: expected frames in the results, found none; run the case with run.output_interval_s above 0".into(),
        ));
    };
    let high = large_displacement(&displacements(source, &first.poses));
    let size = source.case.plan.bed.size;
    let view = SceneView { model: &source.model, frames: &source.frames, size, high };
    page.figure(&view.html());
    page.note(&format!(
        "Turn with the mouse, move with the right button, zoom with the wheel. Stones are shaded by their displacement since \
         the first frame, the last shade from {} mm on. Cutting away hides stones and sleepers in front, not tines.",
        figure(high, 2)
    ));
    Ok(())
}

/// Returns the upper edge of the pictures, a little above fill and sleepers, m.
fn picture_top(source: &ReportSource) -> f64 {
    let plan = &source.case.plan;
    let preparation = &plan.bed.preparation;
    let blocks = plan.sleepers.iter().flat_map(|s| &s.blocks).map(|b| b.size.z);
    let block = preparation.ballast_depth + blocks.fold(0.0, f64::max);
    preparation.fill_level.max(block) + 2.5 * plan.bed.grains.mean_size()
}

fn compactness(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("Compactness");
    let bands = charts::phases(&source.rows);
    for chart in charts::compactness(source, &bands) {
        page.figure(&chart.svg());
    }
    let plan = &source.case.plan;
    let y = plan.sleepers.iter().find(|s| s.tamped).and_then(|s| {
        let block = s.blocks.first()?;
        let middle = s.centre[1] + block.offset_y;
        Some([middle - 0.5 * block.size.y, middle + 0.5 * block.size.y])
    });
    let y = y.unwrap_or([0.0, plan.bed.size.y]);
    let d = plan.bed.grains.mean_size();
    let top = plan.bed.preparation.fill_level + d;
    let grid = CompactnessGrid::over(&plan.bed.size, top, y, 0.75 * d);
    let legend = Legend { low: 0.1, high: 0.7, label: "compactness of the cell".into() };
    let map = |title: &str, poses: &[Pose]| grid.map(title, &source.model, poses, &legend);
    let mut drawings = Vec::new();
    if let Some(first) = source.frames.first() {
        drawings.push(map("Before", &first.poses));
    }
    for phase in [TampingPhase::Insertion, TampingPhase::Squeeze] {
        if let Some((title, frame)) = source.end_of(phase) {
            drawings.push(map(&title, &frame.poses));
        }
    }
    drawings.push(map("End", &last_poses(source)));
    page.figures(&drawings);
    page.note(&format!(
        "Mean over y from {} to {} m, exact volumes of clipped polyhedra. Cells of {} x {} mm contain few grains, so single \
         cells scatter. Brown: filled by sleeper or tines, whose outlines are drawn; blank: no grain.",
        figure(y[0], 3),
        figure(y[1], 3),
        figure(1e3 * grid.x[1], 2),
        figure(1e3 * grid.z[1], 2)
    ));
    page.table(&summary_text::tables(&source.summary)[0]);
    page.figure(&charts::coordination(source, &bands).svg());
}

fn forces(source: &ReportSource, squeezes: &[SqueezeOutcome], page: &mut HtmlPage) {
    let bands = charts::phases(&source.rows);
    let has = |role| source.summary.settings().tracked.iter().any(|f| f.role == role);
    if source.summary.settings().tracked.is_empty() {
        return;
    }
    page.heading(match has(Role::Plate) {
        true => "Forces of the ballast on driven bodies",
        false => "Forces of the ballast on tines and sleepers",
    });
    for (role, title) in [
        (Role::Tine, "Force on tines"),
        (Role::Sleeper, "Force on sleepers"),
        (Role::Plate, "Force on plates"),
    ] {
        if has(role) {
            page.figure(&charts::forces(source, role, title, &bands).svg());
        }
    }
    page.note(&match charts::force_window(source) {
        1 if period(source) == 1 => "Force magnitude of each step.".into(),
        1 => format!("Force magnitude of each step; the run is shorter than a vibration period ({} steps).", period(source)),
        steps => format!(
            "Force averaged over a vibration period ({steps} steps), magnitude. The table has the peaks of single steps."
        ),
    });
    if !squeezes.is_empty() {
        let mut chart = Chart::new(
            "Force against closing, per pair of tines",
            "closing of a side (mm)",
            "force of a side (kN)",
        );
        for squeeze in squeezes {
            let points = squeeze.record.loop_points.iter().map(|p| [1e3 * p[0], 1e-3 * p[1]]);
            chart = chart.with(&squeeze.name, points.collect(), SeriesStyle::Points);
        }
        page.figure(&chart.svg());
        page.table(&squeeze_table(squeezes));
        page.note(&format!(
            "One point per vibration period (28 ms without vibration) or per few periods: mean force of a side along x over its \
             mean closing. A squeeze lasts from the widest position of a pair before it closes until it opens again. \
             Compaction energy is the area under the loop while closing, both sides; work includes all directions and the \
             vibration. Onset: first time with a mean force of a side above {MIN_CONTACT_FORCE} N."
        ));
    }
    for table in &summary_text::tables(&source.summary)[2..5] {
        page.table(table);
    }
}

fn squeeze_table(squeezes: &[SqueezeOutcome]) -> TextTable {
    let header = [
        "onset (s)",
        "closing at onset (mm)",
        "peak force (kN)",
        "closing at peak (mm)",
        "max closing (mm)",
        "compaction energy (J)",
        "work (J)",
    ];
    let mut table = TextTable::new("pair", header);
    for SqueezeOutcome { name, record, .. } in squeezes {
        let farthest = record.loop_points.iter().map(|point| point[0]).fold(0.0, f64::max);
        let onset = record.onset_ns.map_or("-".into(), |t| format!("{:.3}", t as f64 * 1e-9));
        table.row([
            format!("{name}, squeeze {}", record.number),
            onset,
            figure(1e3 * record.onset_closing, 3),
            figure(1e-3 * record.peak_force, 3),
            figure(1e3 * record.peak_closing, 3),
            figure(1e3 * farthest, 3),
            figure(record.compaction_energy, 3),
            figure(record.work, 3),
        ]);
    }
    table
}

fn quality(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("Quality of the solution");
    let bands = charts::phases(&source.rows);
    page.figure(&charts::penetration(source, &bands).svg());
    page.figure(&charts::residual(source, &bands).svg());
    page.figure(&charts::iterations(source, &bands).svg());
    page.table(&summary_text::tables(&source.summary)[6]);
}

fn energy(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("Energy");
    let bands = charts::phases(&source.rows);
    for chart in charts::energy(source, &bands) {
        page.figure(&chart.svg());
    }
    page.table(&summary_text::tables(&source.summary)[5]);
    page.note("Balance error: energy that the ledger leaves unaccounted for; zero for an exact integrator.");
}

fn profile(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("Wall time");
    match charts::profile(source) {
        Some(bars) => page.figure(&bars.svg()),
        None => page.note("No profile: the run is unfinished."),
    }
}

fn provenance(source: &ReportSource, page: &mut HtmlPage) {
    page.heading("Settings and provenance");
    let plan = &source.case.plan;
    let (stepping, solver) = (&source.model.stepping, &source.model.solver);
    let mut table = TextTable::new("setting", ["value"]);
    let size = |v: &Vec3| format!("{} × {} × {} m", v.x, v.y, v.z);
    let vibration = plan.tamping.map(|t| t.vibration);
    for (name, value) in [
        ("case", plan.name.clone()),
        ("program", source.program.clone()),
        ("state hash", source.state_hash.clone()),
        ("key of the bed", source.bed_key.clone()),
        ("seed of the bed", plan.bed.seed.to_string()),
        ("box", size(&plan.bed.size)),
        ("mean grain size", format!("{} mm", figure(1e3 * plan.bed.grains.mean_size(), 3))),
        ("friction between grains", source.model.grain_friction.to_string()),
        (
            "vibration",
            vibration.map_or("none".into(), |v| {
                format!("{} Hz, {} mm", v.frequency, figure(1e3 * v.amplitude, 3))
            }),
        ),
        ("time step", format!("{} ms", figure(1e3 * stepping.h(), 4))),
        ("θ", stepping.theta.to_string()),
        ("detection distance", format!("{} mm", figure(1e3 * stepping.detection_distance, 3))),
        ("schedule", solver.schedule.name().into()),
        ("subdomains", partition(&solver.partition)),
        ("max. iterations", format!("{} per solve pass", solver.max_iterations)),
        ("tolerance", tolerance(solver)),
        ("warm start factor", solver.warm_start_factor.to_string()),
        (
            "penetration correction",
            solver.penetration_correction.map_or("none".into(), |r| {
                format!("factor {}, slop {} µm", r.factor, figure(1e6 * r.slop, 3))
            }),
        ),
    ] {
        table.row([name.to_string(), value]);
    }
    page.table(&table);
    page.details("Case file", &source.case.text);
}

fn partition(rule: &PartitionRule) -> String {
    match rule {
        PartitionRule::Boxes([x, y, z]) => format!("{x} × {y} × {z} boxes"),
        PartitionRule::Balanced(n) => format!("{n}, balanced"),
        PartitionRule::ContactsPer(n) => format!("of about {n} contacts"),
    }
}

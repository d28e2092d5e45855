//! Conversion of a case file to the plan of its scenario.

use crate::case_file::{self, CaseFile};
use crate::check;
use crate::layout::Layout;
use crate::report::DiagnosticReport;
use crate::stiffness::contact_stiffness;
use ballast::geometry::GrainShape;
use ballast::math::Vec3;
use ballast::track::plan::{
    BedPlan, FrictionPlan, GrainPlan, InsertionPlan, LiftPlan, LoadCycles, Plan, PreparationPlan,
    ReleasePlan, RunPlan, SizeClass, SqueezePlan, StiffnessPlan, SubgradePlan, TampingPlan,
    TrafficPlan, VibrationPlan, classes_of_grading,
};

/// Converts `case` to a plan, which is valid only if `report` has no error afterwards.
pub fn resolve(case: &CaseFile, report: &mut DiagnosticReport) -> Plan {
    let layout = Layout::of(case, report);
    let bed = bed(case, &layout, report);
    let run = check::run(case, report);
    let tamping = case.tamping.as_ref().map(|t| tamping(t, &run));
    let [x, y, _] = case.bed.size_m;
    check::bed(case, &bed, report);
    check::names(case, &layout, report);
    check::collisions(&layout, [x, y], tamping.as_ref(), report);
    check::machine(tamping.as_ref(), &bed, &layout, &run, report);
    check::plates(tamping.as_ref(), &bed, &layout, &run, report);
    check::plausibility(case, &layout, tamping.as_ref(), report);
    Plan {
        name: case.name.clone(),
        bed,
        sleepers: layout.sleepers.into_iter().map(|s| s.plan).collect(),
        tines: layout.tines.into_iter().map(|t| t.plan).collect(),
        plates: layout.plates.into_iter().map(|p| p.plan).collect(),
        tamping,
        run,
    }
}

fn bed(case: &CaseFile, layout: &Layout, report: &mut DiagnosticReport) -> BedPlan {
    let bed = &case.bed;
    BedPlan {
        size: Vec3::from(bed.size_m),
        seed: bed.seed,
        density: bed.density_kg_per_m3,
        grains: grains(&bed.grains),
        friction: FrictionPlan {
            grain: bed.friction.grain,
            sleeper: bed.friction.sleeper,
            tine: bed.friction.tine,
            boundary: bed
                .walls
                .by_name()
                .map(|(_, wall)| wall.friction.unwrap_or(bed.friction.boundary)),
        },
        stiffness: stiffness(&bed.stiffness, &bed.walls),
        gravity: bed.gravity_m_per_s2,
        preparation: preparation(bed, layout, report),
        subgrade: bed.subgrade.map(|soil| SubgradePlan {
            modulus: soil.modulus,
            damping_ratio: soil.damping_ratio,
            mass_per_area: soil.mass_kg_per_m2,
        }),
        traffic: bed.traffic.as_ref().map(traffic),
    }
}

fn stiffness(
    stiffness: &case_file::StiffnessSection,
    walls: &case_file::WallsSection,
) -> StiffnessPlan {
    let of = |normal: Option<f64>| contact_stiffness(stiffness, normal);
    StiffnessPlan {
        grain: of(None),
        sleeper: of(stiffness.sleeper),
        tine: of(stiffness.tine),
        boundary: walls.by_name().map(|(_, wall)| of(wall.stiffness.or(stiffness.boundary))),
    }
}

pub fn grains(grains: &case_file::GrainsSection) -> GrainPlan {
    let of_class =
        |c: &case_file::SizeClassSection| SizeClass::of_size(c.size_m, c.number_fraction);
    let classes = match &grains.grading {
        Some(points) => {
            let curve: Vec<[f64; 2]> = points.iter().map(|p| [p.sieve_m, p.passing]).collect();
            classes_of_grading(&curve)
        }
        None => grains.classes.iter().map(of_class).collect(),
    };
    GrainPlan {
        classes,
        shape: GrainShape {
            vertices: grains.vertices,
            elongation: grains.elongation,
            flatness: grains.flatness,
            angularity: grains.angularity,
        },
        templates: grains.shape_count,
        stones: grains
            .stones
            .iter()
            .map(|stone| stone.corners.iter().map(|c| Vec3::from(*c)).collect())
            .collect(),
    }
}

fn preparation(
    bed: &case_file::BedSection,
    layout: &Layout,
    report: &mut DiagnosticReport,
) -> PreparationPlan {
    let preparation = &bed.preparation;
    let blocks = layout.sleepers.iter().flat_map(|s| &s.plan.blocks);
    let tallest = blocks.map(|b| b.size.z).fold(0.0, f64::max);
    PreparationPlan {
        ballast_depth: bed.sleeper_underside_z_m,
        fill_level: preparation.fill_level_m.unwrap_or(bed.sleeper_underside_z_m + tallest),
        friction: preparation.friction,
        step_ns: check::step_ns(preparation.step_s, "bed.preparation.step_s", report),
        iterations: preparation.iterations,
        rest_speed: preparation.settled_speed_m_per_s,
        max_settling: preparation.max_settling_s,
    }
}

fn traffic(traffic: &case_file::TrafficSection) -> TrafficPlan {
    let case_file::TrafficSection { cycles, max_load, min_load, frequency, settlement_limit_m } =
        *traffic;
    TrafficPlan {
        load: LoadCycles { cycles, max_load, min_load, frequency },
        settlement_limit: settlement_limit_m,
    }
}

fn load_cycles(load: &case_file::LoadCyclesSection) -> LoadCycles {
    let case_file::LoadCyclesSection { cycles, max_load, min_load, frequency } = *load;
    LoadCycles { cycles, max_load, min_load, frequency }
}

fn tamping(tamping: &case_file::TampingSection, run: &RunPlan) -> TampingPlan {
    let release = tamping.release.map(|r| ReleasePlan {
        duration: r.duration_s,
        height: r.height_m.unwrap_or(tamping.lift.height_m),
    });
    let traffic = tamping.traffic.as_ref().map(load_cycles);
    let after_withdrawal =
        release.map_or(0.0, |r| r.duration) + traffic.map_or(0.0, |t| t.duration());
    let withdrawal_start = tamping.start_s
        + tamping.lift.duration_s
        + tamping.insertion.duration_s
        + tamping.squeeze.duration_s
        + tamping.hold_s;
    TampingPlan {
        start: tamping.start_s,
        lift: LiftPlan { height: tamping.lift.height_m, duration: tamping.lift.duration_s },
        insertion: InsertionPlan {
            duration: tamping.insertion.duration_s,
            depth: tamping.insertion.depth_m,
            clearance: tamping.insertion.clearance_m,
            force_limit: tamping.insertion.force_limit,
        },
        squeeze: SqueezePlan {
            duration: tamping.squeeze.duration_s,
            stroke: tamping.squeeze.stroke_m,
            force_limit: tamping.squeeze.force_limit,
        },
        hold: tamping.hold_s,
        withdrawal: tamping
            .withdrawal_s
            .unwrap_or(run.duration_ns as f64 * 1e-9 - withdrawal_start - after_withdrawal),
        vibration: VibrationPlan {
            frequency: tamping.vibration.frequency,
            amplitude: tamping.vibration.amplitude_m,
        },
        release,
        traffic,
    }
}

//! Conversion of columns to model and state.
//!
//! Reads: a [`ColumnReader`]. Contract: the result has consistent lengths; [`crate::validate`] checks its values.

use crate::columns::{
    CONVEX, ELASTIC, FORCE_CHECK, HALF_SPACE, HELD, LOADED, MOUNT, OVERLAP, PLAIN, RECOVERY, SKIP,
    SPRUNG, STIFFNESS, TWIST,
};
use crate::fault::Fault;
use crate::reader::ColumnReader;
use ballast::geometry::{Edge, Polyhedron};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{
    Acceleration, ContactStiffness, DofMode, DrivenBody, Grains, Model, Mount, Norm, Part,
    PartitionRule, PenetrationCorrection, Role, Schedule, Solver, Stepping,
};
use ballast::state::{ContactMemory, DriverState, EnergyLedger, State};
use ballast::window_memory::{
    ReactionHistory, SQUEEZE_TRACK_VERSION, SqueezeTrack, Twist, WindowMemory,
};
use std::ops::Range;
use std::sync::Arc;

/// Returns the model in the columns of `source`.
///
/// # Errors
/// Columns that are missing, of another shape, or no model.
pub fn model<R: ColumnReader>(source: &R) -> Result<Model, R::Error> {
    let shapes = shapes(source)?;
    let ng = source.numbers::<u32>("grains/shape", None, 1)?;
    let grains = Grains {
        mass: source.reals("grains/mass", Some(ng.len()), 1)?,
        inertia: vectors(source, "grains/inertia", Some(ng.len()))?,
        shape: ng,
    };
    let mut driven = driven(source)?;
    let grain_stiffness = read_stiffness(source, &mut driven)?;
    Ok(Model {
        shapes,
        grains,
        driven,
        gravity: vectors(source, "model/gravity", Some(1))?[0],
        grain_friction: source.real("model/grain_friction")?,
        grain_stiffness,
        restitution: source.real("model/restitution")?,
        stepping: Stepping {
            step_ns: source.number("stepping/step_ns")?,
            theta: source.real("stepping/theta")?,
            detection_distance: source.real("stepping/alert")?,
        },
        solver: solver(source)?,
    })
}

/// Sets the stiffness of the driven bodies, and returns that between grains.
fn read_stiffness<R: ColumnReader>(
    source: &R,
    driven: &mut [DrivenBody],
) -> Result<ContactStiffness, R::Error> {
    if !source.has(STIFFNESS) {
        return Ok(ContactStiffness::RIGID);
    }
    // Infinite for the rigid contacts of a model with others.
    let numbers: Vec<f64> = source.numbers(STIFFNESS, Some(1 + driven.len()), 3)?;
    let mut rows = numbers.as_chunks().0.iter().map(|&[normal, tangential_ratio, damping_time]| {
        ContactStiffness { normal, tangential_ratio, damping_time }
    });
    let of_grains = rows.next().unwrap_or_default();
    for (body, stiffness) in driven.iter_mut().zip(rows) {
        body.stiffness = stiffness;
    }
    Ok(of_grains)
}

/// Returns the state of `model` in the columns of `source`.
///
/// # Errors
/// Columns that are missing, of another shape, or no state.
pub fn state<R: ColumnReader>(source: &R, model: &Model) -> Result<State, R::Error> {
    let nb = Some(model.body_count());
    let orientation = source.reals("state/orientation", nb, 4)?;
    let energy = source.reals("state/energy", Some(6), 1)?;
    let elastic =
        if source.has(ELASTIC) { source.reals(ELASTIC, Some(2), 1)? } else { vec![0.0; 2] };
    Ok(State {
        step: source.number("state/step")?,
        time_ns: source.number("state/time_ns")?,
        position: vectors(source, "state/position", nb)?,
        orientation: orientation.as_chunks().0.iter().map(quaternion).collect(),
        velocity: vectors(source, "state/velocity", nb)?,
        angular_velocity: vectors(source, "state/angular_velocity", nb)?,
        contacts: contacts(source)?,
        mount: source
            .reals("state/mount", Some(model.mounted_count()), 7)?
            .as_chunks()
            .0
            .iter()
            .map(pose)
            .collect(),
        window: Arc::new(window(source, model.driven.len())?),
        driver: Arc::new(DriverState {
            kind: source.text("driver/kind")?,
            version: source.number("driver/version")?,
            values: source.reals("driver/values", None, 1)?,
        }),
        energy: EnergyLedger {
            initial_kinetic: energy[0],
            initial_potential: energy[1],
            initial_elastic: elastic[0],
            kinetic: energy[2],
            potential: energy[3],
            elastic: elastic[1],
            work_in: energy[4],
            dissipated: energy[5],
        },
    })
}

/// Reads the window memory; its lengths are checked with the state.
fn window<R: ColumnReader>(source: &R, bodies: usize) -> Result<WindowMemory, R::Error> {
    let fault = |name, expected: String, found: String| {
        Err(source.error(Fault::new(name, expected, found)))
    };
    let version: u32 = source.number("window/squeeze_version")?;
    if version != SQUEEZE_TRACK_VERSION {
        let expected = SQUEEZE_TRACK_VERSION.to_string();
        return fault("window/squeeze_version", expected, version.to_string());
    }
    let numbers = source.reals("window/squeezes", None, 1)?;
    let Some(squeezes) = SqueezeTrack::decode(&numbers) else {
        let found = format!("{} numbers", numbers.len());
        return fault("window/squeezes", "whole records of tine pairs".into(), found);
    };
    let vector = |n: &[f64]| Vec3::new(n[0], n[1], n[2]);
    let twist = |n: &[f64; TWIST]| {
        let (velocity, angular_velocity) = (vector(&n[1..]), vector(&n[4..]));
        (n[0] == 1.0).then_some(Twist { velocity, angular_velocity })
    };
    let reactions = source.reals("window/reactions", None, 6)?;
    let reactions = reactions.as_chunks::<6>().0.iter().map(|n| [vector(n), vector(&n[3..])]);
    let reactions: Vec<[Vec3; 2]> = reactions.collect();
    let rows = reactions.len();
    let Ok(reactions) = ReactionHistory::from_rows(bodies, reactions) else {
        let expected = format!("rows of whole steps of {bodies} driven bodies");
        return fault("window/reactions", expected, format!("{rows} rows"));
    };
    let twists = source.reals("window/twists", None, TWIST)?;
    Ok(WindowMemory {
        twists: twists.as_chunks().0.iter().map(twist).collect(),
        reactions,
        squeezes,
    })
}

fn contacts<R: ColumnReader>(source: &R) -> Result<ContactMemory, R::Error> {
    let bodies: Vec<u32> = source.numbers("contacts/bodies", None, 2)?;
    let bodies = bodies.as_chunks().0.to_vec();
    let nc = Some(bodies.len());
    Ok(ContactMemory {
        feature: source.numbers("contacts/feature", nc, 1)?,
        local_point: vectors(source, "contacts/local_point", nc)?,
        impulse: vectors(source, "contacts/impulse", nc)?,
        overlap: if source.has(OVERLAP) {
            source.reals(OVERLAP, nc, 1)?
        } else {
            vec![0.0; bodies.len()]
        },
        bodies,
    })
}

/// Returns a quaternion with the written components, because normalising would change the last bits.
fn quaternion(c: &[f64; 4]) -> Quat {
    Quat::new_unchecked(nalgebra::Quaternion::new(c[0], c[1], c[2], c[3]))
}

/// Returns a pose from position and orientation w x y z.
pub fn pose(p: &[f64; 7]) -> Pose {
    Pose {
        position: Vec3::new(p[0], p[1], p[2]),
        orientation: quaternion(&[p[3], p[4], p[5], p[6]]),
    }
}

fn vectors<R: ColumnReader>(
    source: &R,
    name: &str,
    rows: Option<usize>,
) -> Result<Vec<Vec3>, R::Error> {
    let flat = source.reals(name, rows, 3)?;
    Ok(flat.as_chunks::<3>().0.iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect())
}

/// Returns ranges into flat arrays from starts `[items + 1]`; the last start is the arrays' length.
fn ranges<R: ColumnReader>(
    source: &R,
    name: &str,
    items: Option<usize>,
) -> Result<Vec<Range<usize>>, R::Error> {
    let starts: Vec<u64> = source.numbers(name, items.map(|n| n + 1), 1)?;
    // No flat array can have more elements than the file has bytes.
    let bounded = starts.last().is_some_and(|&n| n <= source.size());
    if !bounded || starts[0] != 0 || !starts.is_sorted() {
        let expected = format!("starts from 0, rising, up to {} at most", source.size());
        let found = format!("{:?}", &starts[..starts.len().min(8)]);
        return Err(source.error(Fault::new(name, expected, found)));
    }
    Ok(starts.windows(2).map(|w| w[0] as usize..w[1] as usize).collect())
}

fn total(ranges: &[Range<usize>]) -> Option<usize> {
    Some(ranges.last().map_or(0, |r| r.end))
}

fn shapes<R: ColumnReader>(source: &R) -> Result<Vec<Polyhedron>, R::Error> {
    let volume = source.reals("shapes/volume", None, 1)?;
    let ns = Some(volume.len());
    let of_vertices = ranges(source, "shapes/first_vertex", ns)?;
    let of_faces = ranges(source, "shapes/first_face", ns)?;
    let of_corners = ranges(source, "shapes/first_face_vertex", ns)?;
    let of_edges = ranges(source, "shapes/first_edge", ns)?;
    let nf = total(&of_faces);

    let vertices = vectors(source, "shapes/vertices", total(&of_vertices))?;
    let normals = vectors(source, "shapes/face_normals", nf)?;
    let offsets = source.reals("shapes/face_offsets", nf, 1)?;
    // Each shape has one start more than faces.
    let starts: Vec<u32> = source.numbers("shapes/face_starts", nf.map(|n| n + volume.len()), 1)?;
    let corners: Vec<u16> = source.numbers("shapes/face_vertices", total(&of_corners), 1)?;
    let edges: Vec<u16> = source.numbers("shapes/edges", total(&of_edges), 4)?;
    let edges = edges.as_chunks::<4>().0;
    let inertia = vectors(source, "shapes/unit_inertia", ns)?;
    let radius = source.reals("shapes/radius", ns, 1)?;

    let shape = |s: usize| Polyhedron {
        vertices: vertices[of_vertices[s].clone()].to_vec(),
        face_normals: normals[of_faces[s].clone()].to_vec(),
        face_offsets: offsets[of_faces[s].clone()].to_vec(),
        face_starts: starts[of_faces[s].start + s..of_faces[s].end + s + 1].to_vec(),
        face_vertices: corners[of_corners[s].clone()].to_vec(),
        edges: edges[of_edges[s].clone()].iter().map(edge).collect(),
        volume: volume[s],
        unit_inertia: inertia[s],
        radius: radius[s],
    };
    Ok((0..volume.len()).map(shape).collect())
}

fn edge(e: &[u16; 4]) -> Edge {
    Edge { vertices: [e[0], e[1]], faces: [e[2], e[3]] }
}

fn driven<R: ColumnReader>(source: &R) -> Result<Vec<DrivenBody>, R::Error> {
    let names = source.texts("driven/name", None)?;
    let nd = Some(names.len());
    let roles = source.texts("driven/role", nd)?;
    let friction = source.reals("driven/friction", nd, 1)?;
    let rows = source.reals("driven/mount", None, MOUNT)?;
    let mounts: Vec<Mount> =
        rows.as_chunks().0.iter().map(|row| mount(source, row)).collect::<Result<_, _>>()?;
    let of_parts = ranges(source, "driven/first_part", nd)?;
    let parts = parts(source, total(&of_parts))?;
    let body = |(d, name): (usize, String)| {
        Ok(DrivenBody {
            name,
            role: source.choose("driven/role", &roles[d], &Role::ALL, Role::name)?,
            friction: friction[d],
            stiffness: ContactStiffness::RIGID,
            parts: parts[of_parts[d].clone()].to_vec(),
            mount: mounts.get(d).copied(),
        })
    };
    names.into_iter().enumerate().map(body).collect()
}

fn mount<R: ColumnReader>(source: &R, row: &[f64; MOUNT]) -> Result<Mount, R::Error> {
    let freedom = |&[mode, stiffness, damping]: &[f64; 3]| match mode {
        HELD => Ok(DofMode::Prescribed),
        LOADED => Ok(DofMode::Free),
        SPRUNG => Ok(DofMode::Spring { stiffness, damping }),
        _ => {
            let expected = format!("modes {HELD}, {LOADED} or {SPRUNG}");
            Err(source.error(Fault::new("driven/mount", expected, mode.to_string())))
        }
    };
    let modes: Vec<DofMode> =
        row[7..].as_chunks().0.iter().map(freedom).collect::<Result<_, _>>()?;
    Ok(Mount {
        mass: row[0],
        inertia: Vec3::new(row[1], row[2], row[3]),
        centre: Vec3::new(row[4], row[5], row[6]),
        dof_modes: std::array::from_fn(|k| modes[k]),
    })
}

fn parts<R: ColumnReader>(source: &R, count: Option<usize>) -> Result<Vec<Part>, R::Error> {
    let kinds: Vec<u8> = source.numbers("parts/kind", count, 1)?;
    let shapes: Vec<u32> = source.numbers("parts/shape", count, 1)?;
    let placements = source.reals("parts/placement", count, 7)?;
    let part = |((kind, shape), p): ((u8, u32), &[f64; 7])| match kind {
        CONVEX => Ok(Part::Convex { shape, pose: pose(p) }),
        HALF_SPACE => Ok(Part::HalfSpace { normal: Vec3::new(p[0], p[1], p[2]), offset: p[3] }),
        found => {
            let expected = "0 (convex) or 1 (half-space)";
            Err(source.error(Fault::new("parts/kind", expected, found)))
        }
    };
    kinds.into_iter().zip(shapes).zip(placements.as_chunks().0).map(part).collect()
}

fn solver<R: ColumnReader>(source: &R) -> Result<Solver, R::Error> {
    let tolerance = source.reals("solver/tolerance", None, 1)?;
    if tolerance.len() > 1 {
        let found = format!("{} values", tolerance.len());
        let fault = Fault::new("solver/tolerance", "one value or none", found);
        return Err(source.error(fault));
    }
    Ok(Solver {
        schedule: source.choice("solver/schedule", &Schedule::ALL, Schedule::name)?,
        partition: partition(source)?,
        max_iterations: source.number("solver/iterations")?,
        subdomain_sweeps: source.number("solver/subdomain_sweeps")?,
        interface_sweeps: source.number("solver/interface_sweeps")?,
        tolerance: tolerance.first().copied(),
        norm: source.choice("solver/norm", &Norm::ALL, Norm::name)?,
        convergence_check_interval: source.number("solver/check_every")?,
        force_check_interval: if source.has(FORCE_CHECK) {
            source.number(FORCE_CHECK)?
        } else {
            Solver::default().force_check_interval
        },
        relaxation: source.real("solver/relaxation")?,
        warm_start_factor: source.real("solver/warm_start")?,
        acceleration: if source.has(PLAIN) { Acceleration::None } else { Acceleration::Nncg },
        skip_converged_subdomains: source.has(SKIP),
        penetration_correction: penetration_correction(source)?,
    })
}

fn penetration_correction<R: ColumnReader>(
    source: &R,
) -> Result<Option<PenetrationCorrection>, R::Error> {
    if !source.has(RECOVERY) {
        return Ok(None);
    }
    let numbers = source.reals(RECOVERY, Some(2), 1)?;
    Ok(Some(PenetrationCorrection {
        factor: numbers[0],
        slop: numbers[1],
        iterations: source.number("solver/recovery_iterations")?,
    }))
}

fn partition<R: ColumnReader>(source: &R) -> Result<PartitionRule, R::Error> {
    let rule = source.text("solver/partition")?;
    let numbers: Vec<u32> = source.numbers("solver/partition_numbers", None, 1)?;
    match (rule.as_str(), &numbers[..]) {
        ("boxes", &[x, y, z]) => Ok(PartitionRule::Boxes([x, y, z])),
        ("balanced", &[n]) => Ok(PartitionRule::Balanced(n)),
        ("contacts per", &[n]) => Ok(PartitionRule::ContactsPer(n)),
        _ => {
            let found = format!("{rule:?} with {} numbers", numbers.len());
            let expected = "\"boxes\" with 3 numbers, \"balanced\" or \"contacts per\" with 1";
            Err(source.error(Fault::new("solver/partition", expected, found)))
        }
    }
}

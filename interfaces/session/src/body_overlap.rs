//! Check for overlaps of driven bodies along recorded motions, which no contact prevents.

use ballast::component::{MotionInput, Waveform};
use ballast::geometry::{Clipper, HalfSpace, half_spaces_of};
use ballast::math::Pose;
use ballast::model::{Model, Part, Role};
use ballast::state::State;

/// Overlap that is not reported, m: accuracy of recorded poses.
const OVERLAP_TOLERANCE_M: f64 = 1e-4;

/// Returns a warning about the first knot up to `end_ns` at which a moved tine, sleeper or plate overlaps another driven body.
pub fn overlap_warning(
    model: &Model,
    state: &State,
    inputs: &[MotionInput],
    end_ns: u64,
) -> Option<String> {
    let knots = inputs.iter().flat_map(|input| &input.waveform.knots);
    let mut times: Vec<u64> = knots.map(|knot| knot.time_ns).filter(|t| *t <= end_ns).collect();
    times.sort_unstable();
    times.dedup();
    let motion = |name: &str| inputs.iter().find(|input| input.body == name).map(|i| &i.waveform);
    let motions: Vec<Option<&Waveform>> = model.driven.iter().map(|d| motion(&d.name)).collect();
    let all = 0..model.driven.len();
    let is_moved = |d: usize| motions[d].is_some() && model.driven[d].role != Role::Boundary;
    // Plates may reach beyond the box of the bed.
    let may_overlap = |a: usize, b: usize| {
        [[a, b], [b, a]].iter().any(|[a, b]| {
            model.driven[*a].role == Role::Plate && model.driven[*b].role == Role::Boundary
        })
    };
    // Each pair of moved bodies once.
    let pairs: Vec<[usize; 2]> = all
        .clone()
        .filter(|a| is_moved(*a))
        .flat_map(|a| all.clone().filter(move |b| *b != a).map(move |b| [a, b]))
        .filter(|[a, b]| (a < b || !is_moved(*b)) && !may_overlap(*a, *b))
        .collect();
    let mut clipper = Clipper::default();
    times.into_iter().find_map(|time| {
        let pose = |d: usize| motions[d].map_or_else(|| state.imposed(model, d), |w| w.pose(time));
        let poses: Vec<Pose> = all.clone().map(pose).collect();
        let [a, b] = *pairs.iter().find(|pair| overlap(model, **pair, &poses, &mut clipper))?;
        let [a, b] = [a, b].map(|d| &model.driven[d].name);
        Some(format!(
            "poses of {a:?}: expected a motion clear of other driven bodies, which have no contacts with each other, found an \
             overlap with {b:?} at {:.4} s of the run",
            time as f64 * 1e-9
        ))
    })
}

/// Returns true if a part of the first body lies deeper than [`OVERLAP_TOLERANCE_M`] in one of the second.
fn overlap(model: &Model, [a, b]: [usize; 2], poses: &[Pose], clipper: &mut Clipper) -> bool {
    model.driven[a].parts.iter().any(|part| {
        let Part::Convex { shape, pose } = part else { return false };
        let (solid, pose) = (&model.shapes[*shape as usize], poses[a].then(pose));
        model.driven[b].parts.iter().any(|other| {
            let mut planes = match other {
                Part::HalfSpace { normal, offset } => {
                    vec![HalfSpace { normal: *normal, offset: *offset }.at(&poses[b])]
                }
                Part::Convex { shape, pose: at } => {
                    let (other, at) = (&model.shapes[*shape as usize], poses[b].then(at));
                    if (at.position - pose.position).norm() > solid.radius + other.radius {
                        return false;
                    }
                    half_spaces_of(other, &at)
                }
            };
            planes.iter_mut().for_each(|plane| plane.offset -= OVERLAP_TOLERANCE_M);
            clipper.volume_inside(solid, &pose, &planes) > 0.0
        })
    })
}

//! Validation of a model's constants.

use super::{ContactStiffness, DofMode, Model, Mount, Part, PartitionRule};
use crate::error::{Error, Result};

/// Valid coefficients of friction; kernels store them as f32.
const FRICTION: &str = "at least 0, at most 1e30";
/// Valid masses (kg) of grains and mounts, and moments of inertia (kg m²) of rotating mounts.
///
/// Kernels store effective masses as f32.
const MASS_RANGE: std::ops::RangeInclusive<f64> = 1e-30..=1e30;
/// Maximum number of parts of a driven body; the identity of contacts contains their number.
const MAX_PARTS: usize = 4096;

fn is_friction(friction: f64) -> bool {
    (0.0..=1e30).contains(&friction)
}

/// Returns an error with `found` unless `good`.
pub(crate) fn expect(
    good: bool,
    place: &str,
    expected: &str,
    found: impl std::fmt::Debug,
) -> Result<()> {
    if good {
        return Ok(());
    }
    Err(Error::Model {
        place: place.into(),
        expected: expected.into(),
        found: format!("{found:?}"),
    })
}

/// Valid stiffness of a contact, N/m, where it is finite; kernels store compliances as f32.
const STIFFNESS_RANGE: std::ops::RangeInclusive<f64> = 1.0..=1e15;

fn check_stiffness(place: &str, stiffness: &ContactStiffness) -> Result<()> {
    let ContactStiffness { normal, tangential_ratio, damping_time } = *stiffness;
    let is_stiffness = |x: f64| x == f64::INFINITY || STIFFNESS_RANGE.contains(&x);
    let expected = "a contact stiffness from 1 to 1e15 N/m, or infinite";
    expect(is_stiffness(normal), place, expected, normal)?;
    expect(
        tangential_ratio > 0.0 && is_stiffness(stiffness.tangential()),
        place,
        "a ratio of tangential to normal stiffness above 0, infinite where the contact is rigid",
        tangential_ratio,
    )?;
    expect(
        (0.0..=1.0).contains(&damping_time),
        place,
        "a damping time of a contact from 0 to 1 s",
        damping_time,
    )
}

impl Model {
    /// Checks every constant: finite, of the right sign, indices in range, names unique.
    ///
    /// # Errors
    /// [`Error::Model`] with the first offending place.
    pub fn check(&self) -> Result<()> {
        let stepping = &self.stepping;
        expect(stepping.step_ns > 0, "stepping.step_ns", "above 0", stepping.step_ns)?;
        expect(
            (0.5..=1.0).contains(&stepping.theta),
            "stepping.theta",
            "between 0.5 and 1",
            stepping.theta,
        )?;
        expect(
            stepping.detection_distance.is_finite() && stepping.detection_distance >= 0.0,
            "stepping.detection_distance",
            "a finite distance of at least 0 m",
            stepping.detection_distance,
        )?;
        expect(
            self.gravity.iter().all(|g| g.is_finite()),
            "gravity",
            "finite components",
            self.gravity,
        )?;
        expect(is_friction(self.grain_friction), "grain_friction", FRICTION, self.grain_friction)?;
        check_stiffness("grain_stiffness", &self.grain_stiffness)?;
        let (valid, expected) = if self.is_rigid() {
            (0.0..=1.0, "between 0 and 1")
        } else {
            (0.0..=0.0, "0 where contacts have a stiffness, whose springs return the bodies")
        };
        expect(valid.contains(&self.restitution), "restitution", expected, self.restitution)?;
        self.check_solver()?;
        self.check_grains()?;
        self.check_driven()
    }

    fn check_solver(&self) -> Result<()> {
        let solver = &self.solver;
        expect(
            solver.max_iterations > 0,
            "solver.max_iterations",
            "at least 1",
            solver.max_iterations,
        )?;
        expect(
            solver.subdomain_sweeps > 0 && solver.interface_sweeps > 0,
            "solver.subdomain_sweeps, solver.interface_sweeps",
            "at least 1",
            (solver.subdomain_sweeps, solver.interface_sweeps),
        )?;
        expect(
            solver.convergence_check_interval > 0,
            "solver.convergence_check_interval",
            "at least 1",
            solver.convergence_check_interval,
        )?;
        expect(
            solver.relaxation > 0.0 && solver.relaxation <= 1.0,
            "solver.relaxation",
            "above 0, at most 1",
            solver.relaxation,
        )?;
        expect(
            (0.0..=1.0).contains(&solver.warm_start_factor),
            "solver.warm_start_factor",
            "between 0 and 1",
            solver.warm_start_factor,
        )?;
        let subdomains = solver.partition.requested_subdomains();
        let expected = format!("at most {} subdomains", PartitionRule::MAX_SUBDOMAINS);
        expect(
            subdomains <= PartitionRule::MAX_SUBDOMAINS,
            "solver.partition",
            &expected,
            subdomains,
        )?;
        if let Some(r) = &solver.penetration_correction {
            let factor = r.factor > 0.0 && r.factor <= 1.0;
            expect(factor, "solver.penetration_correction.factor", "above 0, at most 1", r.factor)?;
            let slop = r.slop.is_finite() && r.slop >= 0.0;
            expect(slop, "solver.penetration_correction.slop", "finite, not below 0", r.slop)?;
            let iterations = r.iterations;
            expect(
                iterations > 0,
                "solver.penetration_correction.iterations",
                "at least 1",
                iterations,
            )?;
        }
        expect(
            solver.tolerance.is_none_or(|t| t.is_finite() && t > 0.0),
            "solver.tolerance",
            "finite, above 0 (none: all iterations)",
            solver.tolerance.unwrap_or_default(),
        )
    }

    fn check_grains(&self) -> Result<()> {
        let grains = &self.grains;
        expect(
            grains.mass.len() == grains.len() && grains.inertia.len() == grains.len(),
            "grains",
            "arrays of one length",
            (grains.len(), grains.mass.len(), grains.inertia.len()),
        )?;
        for i in 0..grains.len() {
            let (shape, mass, inertia) = (grains.shape[i], grains.mass[i], grains.inertia[i]);
            let place = || format!("grain {i}");
            let positive = |x: f64| x.is_finite() && x > 0.0;
            expect((shape as usize) < self.shapes.len(), &place(), "a shape of the model", shape)?;
            expect(MASS_RANGE.contains(&mass), &place(), "a mass from 1e-30 to 1e30 kg", mass)?;
            expect(
                inertia.iter().all(|&j| positive(j)),
                &place(),
                "finite moments of inertia above 0",
                inertia,
            )?;
        }
        Ok(())
    }

    fn check_driven(&self) -> Result<()> {
        for (d, body) in self.driven.iter().enumerate() {
            let place = format!("driven body {:?}", body.name);
            expect(self.driven_index(&body.name) == Some(d), &place, "a unique name", &body.name)?;
            expect(
                is_friction(body.friction),
                &place,
                &format!("a friction, {FRICTION}"),
                body.friction,
            )?;
            check_stiffness(&place, &body.stiffness)?;
            if let Some(mount) = &body.mount {
                expect(d < self.mounted_count(), &place, "mounted bodies before all others", d)?;
                mount.check(&place)?;
            }
            let parts = body.parts.len();
            let expected = format!("1 to {MAX_PARTS} parts");
            expect((1..=MAX_PARTS).contains(&parts), &place, &expected, parts)?;
            for part in &body.parts {
                let good = match part {
                    Part::Convex { shape, pose } => {
                        (*shape as usize) < self.shapes.len() && pose.is_sound()
                    }
                    Part::HalfSpace { normal, offset } => {
                        (normal.norm() - 1.0).abs() < 1e-9 && offset.is_finite()
                    }
                };
                expect(
                    good,
                    &place,
                    "a known shape at a finite pose with a unit quaternion, or a unit normal",
                    part,
                )?;
            }
        }
        Ok(())
    }
}

impl Mount {
    fn check(&self, place: &str) -> Result<()> {
        let mass = self.mass;
        expect(
            MASS_RANGE.contains(&mass),
            place,
            "a mount with a mass from 1e-30 to 1e30 kg",
            mass,
        )?;
        expect(
            self.inertia.iter().all(|j| j.is_finite() && *j >= 0.0),
            place,
            "finite moments of inertia of at least 0 kg m²",
            self.inertia,
        )?;
        let known = !self.can_rotate() || self.inertia.iter().all(|j| MASS_RANGE.contains(j));
        let expected = "moments of inertia from 1e-30 to 1e30 kg m² of a mount that can rotate";
        expect(known, place, expected, self.inertia)?;
        let centre = self.centre.iter().all(|x| x.is_finite());
        expect(centre, place, "a finite centre of mass", self.centre)?;
        for freedom in self.dof_modes {
            let good = freedom.spring().iter().all(|x| x.is_finite() && *x >= 0.0);
            expect(good, place, "stiffness and damping, finite and of at least 0", freedom)?;
        }
        let free = self.free_dofs().count();
        expect(
            free > 0,
            place,
            "a degree of freedom that is not prescribed, or no mount",
            self.dof_modes,
        )?;
        expect(
            self.has_isotropic_translations() || free <= 3,
            place,
            "equal modes of all translations, free or spring, or at most three degrees of freedom not prescribed",
            self.dof_modes.map(DofMode::name),
        )
    }
}

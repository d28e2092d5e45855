//! Conversion of the input variables to the motions and loads of a window.
//!
//! An importer gives values, the component receives waveforms. Every motion begins where the last window ended, so that
//! it never jumps.

use crate::bed_backend::BedBackend;
use crate::status::Complaint;
use crate::variable_table::VariableTable;
use crate::variables::Quantity;
use ballast::component::{
    Interpolation, Knot, LoadInput, LoadKnot, LoadWaveform, MotionInput, Waveform, WindowInputs,
};
use ballast::drive::Load;
use ballast::math::{Pose, Quat, Vec3, is_unit, rotation};

/// Inputs that an importer has set.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InputMarks {
    /// True for a body whose motion was set `[nd]`; the others stand still.
    pub moved: Vec<bool>,
    /// True for a body whose velocity or angular velocity was set `[nd]`: its motions are cubic, those of others linear.
    pub twisted: Vec<bool>,
}

impl InputMarks {
    /// Creates the marks of `bodies` driven bodies, of which none was moved.
    pub fn new(bodies: usize) -> Self {
        Self { moved: vec![false; bodies], twisted: vec![false; bodies] }
    }

    /// Marks the body whose motion `quantity` gives.
    pub fn mark(&mut self, quantity: Quantity) {
        if let Some(d) = quantity.moved_body() {
            self.moved[d] = true;
        }
        if let Some(d) = quantity.twisted_body() {
            self.twisted[d] = true;
        }
    }
}

/// Values of the input variables.
pub(crate) struct InputValues<'a> {
    pub table: &'a VariableTable,
    pub values: &'a [f64],
    pub marks: &'a InputMarks,
    /// True if the values hold at the start of the window.
    pub at_start: bool,
}

impl InputValues<'_> {
    /// Returns the inputs of the window from the state of `bed` to `end_ns`, with the names of the driven bodies `[nd]`.
    pub fn window(
        &self,
        bed: &dyn BedBackend,
        bodies: &[String],
        end_ns: u64,
    ) -> Result<WindowInputs, Complaint> {
        let mut inputs = WindowInputs::default();
        for (d, body) in bodies.iter().enumerate() {
            if self.marks.moved[d] {
                let waveform = self.waveform(bed, d, body, end_ns)?;
                let motion = MotionInput { body: body.clone(), waveform, allow_jump: false };
                inputs.motions.push(motion);
            }
            if let (Some(force), Some(torque)) =
                (self.vector(Quantity::LoadForce(d)), self.vector(Quantity::LoadTorque(d)))
            {
                let load = Load { force, torque };
                let knots = vec![LoadKnot { time_ns: bed.now_ns(), load }];
                let waveform = LoadWaveform { is_held: true, knots };
                inputs.loads.push(LoadInput { body: body.clone(), waveform });
            }
        }
        Ok(inputs)
    }

    fn waveform(
        &self,
        bed: &dyn BedBackend,
        d: usize,
        body: &str,
        end_ns: u64,
    ) -> Result<Waveform, Complaint> {
        let now_ns = bed.now_ns();
        let seconds = (end_ns - now_ns) as f64 * 1e-9;
        let position = self.vector(Quantity::Position(d)).unwrap_or_default();
        let orientation = self.orientation(d, body)?;
        let velocity = self.vector(Quantity::Velocity(d)).unwrap_or_default();
        let angular_velocity = self.vector(Quantity::AngularVelocity(d)).unwrap_or_default();
        let is_cubic = self.marks.twisted[d];
        let pose = if self.at_start && is_cubic {
            Pose {
                position: position + velocity * seconds,
                orientation: rotation::advance(&orientation, &(angular_velocity * seconds)),
            }
        } else {
            Pose { position, orientation }
        };
        let end = Knot { time_ns: end_ns, pose, velocity, angular_velocity };
        let (pose, twist) = bed.motion_start(d);
        // After a linear motion any twist is accepted: that of the input changes least.
        let [velocity, angular_velocity] = twist
            .map_or([velocity, angular_velocity], |twist| [twist.velocity, twist.angular_velocity]);
        let start = Knot { time_ns: now_ns, pose, velocity, angular_velocity };
        let interpolation = if is_cubic { Interpolation::Hermite } else { Interpolation::Linear };
        Ok(Waveform { interpolation, knots: vec![start, end] })
    }

    /// Returns the three elements of a quantity; `None` if the unit has no such variable.
    fn vector(&self, quantity: Quantity) -> Option<Vec3> {
        let first = self.table.first(quantity)?;
        Some(Vec3::from_column_slice(&self.values[first..first + 3]))
    }

    /// Returns the orientation of a body; one that is not of unit length, as between two samples, is normalised.
    fn orientation(&self, d: usize, body: &str) -> Result<Quat, Complaint> {
        let Some(first) = self.table.first(Quantity::Orientation(d)) else {
            return Ok(Quat::identity());
        };
        let [x, y, z, w] = self.values[first..first + 4] else { return Ok(Quat::identity()) };
        let q = Quat::new_unchecked(nalgebra::Quaternion::new(w, x, y, z));
        if is_unit(&q) {
            return Ok(q);
        }
        let norm = q.norm();
        if !(norm > 0.1 && norm.is_finite()) {
            let expected = "a quaternion x, y, z, w of unit length";
            return Err(Complaint::discard(format!(
                "orientation of {body:?}: expected {expected}, found length {norm}"
            )));
        }
        Ok(Quat::new_normalize(q.into_inner()))
    }
}

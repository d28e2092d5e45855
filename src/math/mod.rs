//! Vectors, rotations, frames and cones. SI units, right-handed, z up.

pub mod cone;
pub mod frame;
pub mod rotation;

/// 3-vector, f64.
pub type Vec3 = nalgebra::Vector3<f64>;
/// 3 x 3 matrix, f64.
pub type Mat3 = nalgebra::Matrix3<f64>;
/// Rotation body to world (Hamilton).
pub type Quat = nalgebra::UnitQuaternion<f64>;

/// Converts a vector from single precision.
#[inline]
pub fn widen(x: &[f32; 3]) -> Vec3 {
    Vec3::new(x[0].into(), x[1].into(), x[2].into())
}

/// Rounds a vector to single precision.
#[inline]
pub fn round(x: &Vec3) -> [f32; 3] {
    [x.x as f32, x.y as f32, x.z as f32]
}

/// Position (m) of a body's origin and its rotation, body to world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position of the origin, m.
    pub position: Vec3,
    /// Rotation from body to world.
    pub orientation: Quat,
}

impl Pose {
    /// Returns the pose of the world frame.
    pub fn identity() -> Self {
        Self { position: Vec3::zeros(), orientation: Quat::identity() }
    }

    /// Returns a translation (m) without rotation.
    pub fn at(position: Vec3) -> Self {
        Self { position, orientation: Quat::identity() }
    }

    /// Returns the world coordinates of a point given in body coordinates, m.
    pub fn point(&self, local: &Vec3) -> Vec3 {
        self.position + self.orientation * local
    }

    /// Returns the body coordinates of a point given in world coordinates, m.
    pub fn inverse_point(&self, world: &Vec3) -> Vec3 {
        self.orientation.inverse() * (world - self.position)
    }

    /// Returns the pose of a frame that is given in this body's coordinates.
    pub fn then(&self, local: &Pose) -> Pose {
        Pose {
            position: self.point(&local.position),
            orientation: self.orientation * local.orientation,
        }
    }

    /// True if every component is finite and the quaternion is a rotation ([`is_unit`]).
    pub fn is_sound(&self) -> bool {
        self.position.iter().all(|x| x.is_finite()) && is_unit(&self.orientation)
    }
}

/// True if a quaternion has norm 1, to 1e-6. Any other would scale the vectors that it rotates.
pub fn is_unit(q: &Quat) -> bool {
    (q.norm() - 1.0).abs() <= 1e-6
}

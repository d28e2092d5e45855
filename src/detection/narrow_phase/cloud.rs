//! The vertices of one polyhedron in the frame of another: supports in any direction.

use crate::geometry::Polyhedron;
use crate::math::{Mat3, Vec3};

const LANES: usize = 4;

/// Points as structure of arrays, padded with copies of the last point to a whole number of lanes
/// so that supports are computed without a tail.
#[derive(Debug, Default)]
pub struct Cloud {
    x: Vec<[f64; LANES]>,
    y: Vec<[f64; LANES]>,
    z: Vec<[f64; LANES]>,
}

impl Cloud {
    /// Loads the vertices of `shape`, turned by `rotation`, then moved by `translation`.
    pub fn load(&mut self, shape: &Polyhedron, rotation: &Mat3, translation: &Vec3) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
        let r = rotation;
        for chunk in shape.vertices.chunks(LANES) {
            let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                let v = &chunk[k.min(chunk.len() - 1)];
                x[k] = r[(0, 0)] * v.x + r[(0, 1)] * v.y + r[(0, 2)] * v.z + translation.x;
                y[k] = r[(1, 0)] * v.x + r[(1, 1)] * v.y + r[(1, 2)] * v.z + translation.y;
                z[k] = r[(2, 0)] * v.x + r[(2, 1)] * v.y + r[(2, 2)] * v.z + translation.z;
            }
            self.x.push(x);
            self.y.push(y);
            self.z.push(z);
        }
    }

    /// Point `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        let (block, lane) = (i / LANES, i % LANES);
        Vec3::new(self.x[block][lane], self.y[block][lane], self.z[block][lane])
    }

    /// `n · x_i`, by the same operations as [`Cloud::lowest`]: bounds made of it hold to the bit.
    pub fn height(&self, i: usize, n: &Vec3) -> f64 {
        let (block, lane) = (i / LANES, i % LANES);
        n.x * self.x[block][lane] + n.y * self.y[block][lane] + n.z * self.z[block][lane]
    }

    /// Smallest `n · x`.
    pub fn lowest(&self, n: &Vec3) -> f64 {
        let mut low = [f64::INFINITY; LANES];
        for ((x, y), z) in self.x.iter().zip(&self.y).zip(&self.z) {
            for k in 0..LANES {
                let h = n.x * x[k] + n.y * y[k] + n.z * z[k];
                low[k] = if h < low[k] { h } else { low[k] };
            }
        }
        let (a, b) = (smaller(low[0], low[1]), smaller(low[2], low[3]));
        smaller(a, b)
    }

    /// First point whose `n · x` is `value`, as [`Cloud::lowest`] returned it.
    pub fn first_at(&self, n: &Vec3, value: f64) -> usize {
        for (block, ((x, y), z)) in self.x.iter().zip(&self.y).zip(&self.z).enumerate() {
            for k in 0..LANES {
                if n.x * x[k] + n.y * y[k] + n.z * z[k] <= value {
                    return block * LANES + k;
                }
            }
        }
        0
    }
}

/// `f64::min` minds NaN and does not become one instruction; positions are finite here.
fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Largest `n · v` over the vertices of `shape`, in its own frame.
pub fn highest(shape: &Polyhedron, n: &Vec3) -> f64 {
    let mut high = f64::NEG_INFINITY;
    for v in &shape.vertices {
        let h = n.x * v.x + n.y * v.y + n.z * v.z;
        high = if h > high { h } else { high };
    }
    high
}

/// Smallest `n · v` over the vertices of `shape`, in its own frame.
pub fn lowest(shape: &Polyhedron, n: &Vec3) -> f64 {
    -highest(shape, &-n)
}

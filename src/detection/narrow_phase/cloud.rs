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
        let blocks = shape.vertices.len().div_ceil(LANES);
        self.x.resize(blocks, [0.0; LANES]);
        self.y.resize(blocks, [0.0; LANES]);
        self.z.resize(blocks, [0.0; LANES]);
        let [[a, b, c], [d, e, f], [g, h, i]] =
            [0, 1, 2].map(|k| [rotation[(k, 0)], rotation[(k, 1)], rotation[(k, 2)]]);
        let blocks = self.x.iter_mut().zip(&mut self.y).zip(&mut self.z);
        for (((x, y), z), chunk) in blocks.zip(shape.vertices.chunks(LANES)) {
            let last = chunk.len() - 1;
            let v: [&Vec3; LANES] = std::array::from_fn(|k| &chunk[k.min(last)]);
            for k in 0..LANES {
                x[k] = a * v[k].x + b * v[k].y + c * v[k].z + translation.x;
                y[k] = d * v[k].x + e * v[k].y + f * v[k].z + translation.y;
                z[k] = g * v[k].x + h * v[k].y + i * v[k].z + translation.z;
            }
        }
    }

    /// Point `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        let (block, lane) = (i / LANES, i % LANES);
        Vec3::new(self.x[block][lane], self.y[block][lane], self.z[block][lane])
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

impl Cloud {
    /// For each point whether it is at most `slab` above the lowest one along `n`.
    pub fn near_lowest(&self, n: &Vec3, slab: f64, is_near: &mut Vec<bool>) {
        let limit = self.lowest(n) + slab;
        is_near.clear();
        for ((x, y), z) in self.x.iter().zip(&self.y).zip(&self.z) {
            let h: [f64; LANES] = std::array::from_fn(|k| n.x * x[k] + n.y * y[k] + n.z * z[k]);
            is_near.extend(h.map(|h| h <= limit));
        }
    }
}

/// For each vertex whether it is at most `slab` below the highest one along `n`.
pub fn near_highest(shape: &Polyhedron, n: &Vec3, slab: f64, is_near: &mut Vec<bool>) {
    let limit = highest(shape, n) - slab;
    is_near.clear();
    is_near.extend(shape.vertices.iter().map(|v| n.dot(v) >= limit));
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

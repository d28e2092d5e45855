//! Hulls of any points: a polyhedron around all of them, or a refusal.
#![no_main]

use ballast::geometry::convex_hull;
use ballast::math::Vec3;
use libfuzzer_sys::fuzz_target;

/// Points on a coarse lattice (coincident, collinear and coplanar ones abound), or of any bits.
fn points(data: &[u8]) -> Vec<Vec3> {
    let Some((&kind, rest)) = data.split_first() else { return Vec::new() };
    if kind % 4 == 0 {
        let number = |c: &[u8; 8]| f64::from_le_bytes(*c);
        let numbers: Vec<f64> = rest.as_chunks().0.iter().map(number).collect();
        return numbers.as_chunks().0.iter().map(|&[x, y, z]| Vec3::new(x, y, z)).collect();
    }
    let scale = [1e-6, 1e-2, 1e3][usize::from(kind / 4) % 3];
    let point = |&[x, y, z]: &[u8; 3]| Vec3::new(x as i8 as f64, y as i8 as f64, z as i8 as f64);
    rest.as_chunks().0.iter().map(|c| point(c) * scale).collect()
}

fuzz_target!(|data: &[u8]| {
    let points = points(data);
    let Ok((shape, pose)) = convex_hull(&points) else { return };
    assert!(shape.volume > 0.0 && shape.volume.is_finite(), "volume {}", shape.volume);
    assert!(shape.unit_inertia.iter().all(|i| *i > 0.0), "inertia {:?}", shape.unit_inertia);
    for point in &points {
        let local = pose.inverse_point(point);
        for (n, d) in shape.face_normals.iter().zip(&shape.face_offsets) {
            let above = n.dot(&local) - d;
            assert!(above <= 1e-5 * shape.radius, "{point:?} is {above:e} m above a face");
        }
    }
});

//! Stones from surface meshes in all formats, whole and broken.

use ballast::geometry::stone_with_corners;
use ballast_meshes::{MeshStone, TriangleMesh};
use std::path::PathBuf;
use tempfile::TempDir;

const POINTS: [[f32; 3]; 8] = [
    [0.0, 0.0, 0.0],
    [2.0, 0.0, 0.0],
    [2.0, 3.0, 0.0],
    [0.0, 3.0, 0.0],
    [0.0, 0.0, 1.0],
    [2.0, 0.0, 1.0],
    [2.0, 3.0, 1.0],
    [0.0, 3.0, 1.0],
];
const FACES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [0, 4, 7, 3], [1, 2, 6, 5]];

fn triangles() -> Vec<[usize; 3]> {
    FACES.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect()
}

/// A folder with files of meshes.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    /// Returns the message of a file that is no mesh.
    fn error(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.write(name, content);
        let message = MeshStone::read(&path, 30).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("expected"), "{message}");
        message
    }
}

fn stl_ascii(triangles: &[[usize; 3]]) -> String {
    let mut text = "solid brick\n".to_string();
    for t in triangles {
        let corners = t.map(|k| {
            let [x, y, z] = POINTS[k];
            format!("vertex {x} {y} {z}\n")
        });
        text += &format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", corners.concat());
    }
    text + "endsolid brick\n"
}

fn stl_binary(header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles().len() as u32).to_le_bytes());
    for t in triangles() {
        bytes.extend([0; 12]);
        t.iter().flat_map(|k| POINTS[*k]).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn obj() -> String {
    let points = POINTS.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let faces = FACES.map(|[a, b, c, d]| format!("f {} {} {} {}\n", a + 1, b + 1, c + 1, d + 1));
    format!("mtllib none.mtl\no brick\n{points}{}", faces.concat())
}

fn ply_header(format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
         element face 6\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn ply_ascii() -> String {
    let points = POINTS.map(|[x, y, z]| format!("{x} {y} {z}\n")).concat();
    let faces = FACES.map(|[a, b, c, d]| format!("4 {a} {b} {c} {d}\n")).concat();
    ply_header("ascii") + &points + &faces
}

fn ply_binary() -> Vec<u8> {
    let mut bytes = ply_header("binary_little_endian").into_bytes();
    POINTS.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
    for face in FACES {
        bytes.push(4);
        face.iter().for_each(|k| bytes.extend((*k as i32).to_le_bytes()));
    }
    bytes
}

#[test]
fn all_formats_give_the_same_stone() {
    let place = Place::new();
    let files = [
        place.write("a.stl", stl_ascii(&triangles())),
        place.write("b.STL", stl_binary(b"")),
        // As some scanners begin binary files, too.
        place.write("solid.stl", stl_binary(b"solid scan")),
        place.write("c.obj", obj()),
        place.write("d.ply", ply_ascii()),
        place.write("e.ply", ply_binary()),
    ];
    for file in &files {
        let mesh = TriangleMesh::read(file).unwrap();
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (8, 12), "{}", file.display());
        assert!((mesh.volume().unwrap() - 6.0).abs() < 1e-12);
        let stone = MeshStone::read(file, 30).unwrap();
        assert_eq!(stone.corners.len(), 8);
        assert!((stone.volume - 6.0).abs() < 1e-9 && (stone.hull_volume - 6.0).abs() < 1e-9);
        assert!((stone.descriptors.elongation() - 2.0 / 3.0).abs() < 1e-3);
        assert!((stone.descriptors.flatness() - 0.5).abs() < 1e-3);
        let whole = stone_with_corners(&stone.corners).unwrap();
        assert!((whole.nominal_diameter() - 1.0).abs() < 1e-12);
        let size = (36.0 / std::f64::consts::PI).cbrt();
        assert!((stone.nominal_diameter - size).abs() < 1e-9);
    }
}

/// Points of an ellipsoid with bumps, and its triangles.
fn scan(rings: usize, per_ring: usize) -> String {
    let mut text = String::new();
    for i in 0..=rings {
        for j in 0..per_ring {
            let (polar, around) = (
                std::f64::consts::PI * i as f64 / rings as f64,
                std::f64::consts::TAU * j as f64 / per_ring as f64,
            );
            let radius = 1.0 + 0.05 * (7.0 * around).sin() * (5.0 * polar).sin();
            let flat = radius * polar.sin();
            let [x, y, z] = [flat * around.cos(), 0.8 * flat * around.sin(), 0.6 * polar.cos()];
            text += &format!("v {x} {y} {z}\n");
        }
    }
    for i in 0..rings {
        for j in 0..per_ring {
            let at = |i: usize, j: usize| 1 + i * per_ring + j % per_ring;
            text +=
                &format!("f {} {} {} {}\n", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
        }
    }
    text
}

#[test]
fn more_corners_fill_more_of_a_scan() {
    let place = Place::new();
    let file = place.write("scan.obj", scan(100, 120));
    let mut last = 0.0;
    for most in [4, 8, 16, 32, 64] {
        let stone = MeshStone::read(&file, most).unwrap();
        assert!(stone.corners.len() <= most && stone.volume <= stone.hull_volume);
        assert!(stone.volume > last, "{most} corners: {} after {last}", stone.volume);
        last = stone.volume;
        assert_eq!(stone, MeshStone::read(&file, most).unwrap());
    }
    let stone = MeshStone::read(&file, 32).unwrap();
    assert!(stone.volume > 0.75 * stone.hull_volume, "{} of {}", stone.volume, stone.hull_volume);
}

#[test]
fn a_scan_far_from_its_origin_keeps_its_form() {
    let points = POINTS.map(|[x, y, z]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        format!("{} {} {}\n", 4.5e5 + 0.02 * x, 5.4e6 + 0.02 * y, 90.0 + 0.02 * z)
    });
    let faces = FACES.map(|[a, b, c, d]| format!("4 {a} {b} {c} {d}\n")).concat();
    let header = ply_header("ascii").replace("float", "double");
    let place = Place::new();
    let stone =
        MeshStone::read(&place.write("far.ply", header + &points.concat() + &faces), 30).unwrap();
    assert_eq!(stone.corners.len(), 8);
    assert!((stone.volume / (6.0 * 8e-6) - 1.0).abs() < 1e-6, "{}", stone.volume);
}

#[test]
fn an_open_surface_has_no_volume() {
    let place = Place::new();
    let file = place.write("open.stl", stl_ascii(&triangles()[..11]));
    let stone = MeshStone::read(&file, 30).unwrap();
    assert_eq!((stone.mesh_volume, stone.triangles), (None, 11));
    assert!((stone.volume - 6.0).abs() < 1e-9);
}

#[test]
fn broken_files_are_refused() {
    let place = Place::new();
    let message = place.error("cut.stl", &stl_binary(b"")[..300]);
    assert!(message.contains("format STL") && !message.contains('\n'), "{message}");
    place.error("empty.stl", "");
    place.error("text.ply", "no mesh");
    let message = place.error(
        "points.ply",
        ply_ascii().split("element face").next().unwrap().to_string() + "end_header\n",
    );
    assert!(!message.is_empty());
    let message = place.error("far.ply", ply_ascii().replace("4 0 3 2 1", "4 0 3 2 9"));
    assert!(message.contains("point 9 of 8"), "{message}");
    let message = place.error("below.ply", ply_ascii().replace("4 0 3 2 1", "4 0 3 2 -1"));
    assert!(message.contains("face 0"), "{message}");
    place.error("far.obj", obj().replace("f 1 4 3 2", "f 1 4 3 12"));
    let message = place.error("nan.obj", obj().replace("v 2 3 1", "v 2 nan 1"));
    assert!(message.contains("finite coordinates"), "{message}");
    let message = place.error("points.obj", obj().split("f 1").next().unwrap());
    assert!(message.contains("mesh") || message.contains("triangles"), "{message}");
    let message = place.error("flat.stl", stl_ascii(&triangles()[..2]));
    assert!(message.contains("volume"), "{message}");
    let message = place.error("stone.dae", "");
    assert!(message.contains(".stl, .obj or .ply"), "{message}");
    let missing = MeshStone::read(&place.0.path().join("missing.stl"), 30).unwrap_err();
    assert!(missing.to_string().contains("missing.stl"));
}

//! Triangle meshes of STL, OBJ and PLY files.

use crate::MeshError;
use ballast::math::Vec3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;

/// Surface of triangles, in the unit of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct TriangleMesh {
    /// Points, each of them once.
    pub points: Vec<Vec3>,
    /// Indices of the points of each triangle.
    pub triangles: Vec<[usize; 3]>,
}

impl TriangleMesh {
    /// Reads a mesh; the extension of the file's name tells its format: stl, obj or ply, as text or binary.
    ///
    /// # Errors
    /// Files that cannot be opened, other extensions, content that is no mesh, coordinates that are not finite.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let content = |expected: &str, found: &str| MeshError::Content {
            path: path.into(),
            expected: expected.into(),
            // Readers tell reasons in lines.
            found: found.split_whitespace().collect::<Vec<_>>().join(" "),
        };
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let read: fn(BufReader<File>) -> Result<Self, String> = match extension.as_str() {
            "stl" => from_stl,
            "obj" => from_obj,
            "ply" => from_ply,
            "" => return Err(content("a mesh: .stl, .obj or .ply", "no extension")),
            other => return Err(content("a mesh: .stl, .obj or .ply", &format!(".{other}"))),
        };
        let file =
            File::open(path).map_err(|source| MeshError::Open { path: path.into(), source })?;
        let expected = format!("a mesh in the format {}", extension.to_uppercase());
        let mesh = read(BufReader::new(file)).map_err(|found| content(&expected, &found))?;
        if let Some(k) = mesh.points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(content(
                "finite coordinates",
                &format!("{:?} in point {k}", mesh.points[k]),
            ));
        }
        if mesh.triangles.is_empty() {
            return Err(content("triangles", &format!("{} points without any", mesh.points.len())));
        }
        Ok(mesh)
    }

    /// Makes one point of those at the same place.
    fn welded(
        points: impl Iterator<Item = [f64; 3]>,
        triangles: Vec<[usize; 3]>,
    ) -> Result<Self, String> {
        let mut numbers = HashMap::new();
        let mut welded = Vec::new();
        let places: Vec<usize> = points
            .map(|p| {
                // Adding 0 makes one zero of both.
                *numbers.entry(p.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                    welded.push(Vec3::from(p));
                    welded.len() - 1
                })
            })
            .collect();
        let index = |k: usize| {
            places.get(k).copied().ok_or_else(|| format!("point {k} of {} points", places.len()))
        };
        let triangles = triangles
            .into_iter()
            .map(|[a, b, c]| Ok([index(a)?, index(b)?, index(c)?]))
            // Triangles without area, such as those at the poles of a grid.
            .filter(|t| !matches!(t, Ok([a, b, c]) if a == b || b == c || c == a))
            .collect::<Result<_, String>>()?;
        Ok(Self { points: welded, triangles })
    }

    /// Returns the volume inside a closed surface; `None` if the surface has holes or triangles that face both ways.
    pub fn volume(&self) -> Option<f64> {
        let mut edges = HashSet::new();
        let mut edges_of =
            |[a, b, c]: [usize; 3]| [[a, b], [b, c], [c, a]].map(|e| edges.insert(e));
        let is_single = self.triangles.iter().all(|t| edges_of(*t) == [true; 3]);
        let is_closed = is_single && edges.iter().all(|&[a, b]| edges.contains(&[b, a]));
        is_closed.then(|| signed_volume(self.corners()).abs())
    }

    /// Returns the corners of each triangle.
    pub(crate) fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        self.triangles.iter().map(|t| t.map(|k| self.points[k]))
    }

    /// Returns the connected surfaces of a closed mesh, which face outwards.
    pub(crate) fn shells(&self) -> Vec<Self> {
        // Each point leads to another one of its surface, and the last to itself.
        let mut next: Vec<usize> = (0..self.points.len()).collect();
        let last = |next: &[usize], mut k: usize| {
            while next[k] != k {
                k = next[k];
            }
            k
        };
        for [a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c)] {
                let [from, to] = [*from, *to].map(|k| last(&next, k));
                next[from.max(to)] = from.min(to);
            }
        }
        let mut shells: BTreeMap<usize, Vec<[usize; 3]>> = BTreeMap::new();
        for triangle in &self.triangles {
            shells.entry(last(&next, triangle[0])).or_default().push(*triangle);
        }
        shells.into_values().map(|triangles| self.facing_outwards(triangles)).collect()
    }

    fn facing_outwards(&self, mut triangles: Vec<[usize; 3]>) -> Self {
        let of_shell = triangles.iter().map(|t| t.map(|k| self.points[k]));
        if signed_volume(of_shell) < 0.0 {
            triangles.iter_mut().for_each(|t| t.reverse());
        }
        let (mut points, mut numbers) = (Vec::new(), HashMap::new());
        let mut number = |k: usize| {
            *numbers.entry(k).or_insert_with(|| {
                points.push(self.points[k]);
                points.len() - 1
            })
        };
        let triangles = triangles.into_iter().map(|t| t.map(&mut number)).collect();
        Self { points, triangles }
    }
}

/// Returns the volume inside a closed surface, negative if it faces inwards.
pub(crate) fn signed_volume(mut triangles: impl Iterator<Item = [Vec3; 3]>) -> f64 {
    // The first triangle has no volume with its own corner.
    let Some([origin, ..]) = triangles.next() else { return 0.0 };
    let of_triangle = |t: [Vec3; 3]| {
        let [a, b, c] = t.map(|p| p - origin);
        a.cross(&b).dot(&c) / 6.0
    };
    triangles.map(of_triangle).sum()
}

fn from_stl(mut file: impl Read + Seek) -> Result<TriangleMesh, String> {
    let mesh = stl_io::read_stl(&mut file).map_err(|e| e.to_string())?;
    let points = mesh.vertices.iter().map(|v| v.0.map(f64::from));
    TriangleMesh::welded(points, mesh.faces.iter().map(|f| f.vertices).collect())
}

fn from_obj(mut file: impl BufRead) -> Result<TriangleMesh, String> {
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    // Materials are of no interest.
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) =
        tobj::load_obj_buf(&mut file, &options, no_materials).map_err(|e| e.to_string())?;
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for tobj::Model { mesh, .. } in models {
        let first = points.len();
        points.extend(mesh.positions.as_chunks::<3>().0.iter().map(|p| p.map(f64::from)));
        let of_mesh = mesh.indices.as_chunks::<3>().0;
        triangles.extend(of_mesh.iter().map(|t| t.map(|k| first + k as usize)));
    }
    TriangleMesh::welded(points.into_iter(), triangles)
}

fn from_ply(mut file: impl Read) -> Result<TriangleMesh, String> {
    let ply = Parser::<DefaultElement>::new().read_ply(&mut file).map_err(|e| e.to_string())?;
    let elements = |name: &str| ply.payload.get(name).map_or(&[][..], |list| &list[..]);
    let points = elements("vertex").iter().enumerate().map(|(k, vertex)| {
        let coordinate = |axis| vertex.get(axis).and_then(scalar);
        let [x, y, z] = ["x", "y", "z"].map(coordinate);
        x.zip(y)
            .zip(z)
            .map(|((x, y), z)| [x, y, z])
            .ok_or_else(|| format!("vertex {k} without x, y and z"))
    });
    let points: Vec<[f64; 3]> = points.collect::<Result<_, String>>()?;
    let mut triangles = Vec::new();
    for (k, face) in elements("face").iter().enumerate() {
        let list = ["vertex_indices", "vertex_index"].iter().find_map(|name| face.get(*name));
        let corners = list.and_then(indices);
        let corners = corners.ok_or_else(|| format!("face {k} without vertex_indices"))?;
        triangles.extend((2..corners.len()).map(|j| [corners[0], corners[j - 1], corners[j]]));
    }
    TriangleMesh::welded(points.into_iter(), triangles)
}

fn scalar(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(x) => Some(x.into()),
        Property::UChar(x) => Some(x.into()),
        Property::Short(x) => Some(x.into()),
        Property::UShort(x) => Some(x.into()),
        Property::Int(x) => Some(x.into()),
        Property::UInt(x) => Some(x.into()),
        Property::Float(x) => Some(x.into()),
        Property::Double(x) => Some(x),
        _ => None,
    }
}

/// Returns the indices of a face; `None` for values that are none, such as negative ones.
fn indices(property: &Property) -> Option<Vec<usize>> {
    fn of<T: Copy + TryInto<usize>>(list: &[T]) -> Option<Vec<usize>> {
        list.iter().map(|k| (*k).try_into().ok()).collect()
    }
    match property {
        Property::ListChar(list) => of(list),
        Property::ListUChar(list) => of(list),
        Property::ListShort(list) => of(list),
        Property::ListUShort(list) => of(list),
        Property::ListInt(list) => of(list),
        Property::ListUInt(list) => of(list),
        _ => None,
    }
}

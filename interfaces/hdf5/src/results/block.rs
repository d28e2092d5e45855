//! VTKHDF block: moving polygons, or points whose number changes, over time.
//!
//! Writes: VTKHDF 2.3, temporal PolyData (docs.vtk.org, VTK file formats). Contract: a viewer needs
//! nothing but the file. Polygons and constant cell data are stored once: every step's offset is 0.

use super::growing::{
    append, append_portion, ascii, create, create_table, group as make_group, number, read,
    truncate,
};
use hdf5::plist::group_create::LinkCreationOrder;
use hdf5::{Dataset, Group, Result};

/// VTK's four kinds of cells, in VTK's order.
const CELLS: [&str; 4] = ["Vertices", "Lines", "Polygons", "Strips"];

/// Attribute of an array whose rows are valid for all steps.
const CONSTANT: &str = "constant";

pub(crate) struct VtkBlock {
    group: Group,
    steps: Group,
}

/// Location of the values of an array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum FieldLocation {
    /// One value per cell.
    Cells,
    /// One value per point.
    Points,
}

impl FieldLocation {
    fn data(self) -> &'static str {
        if self == FieldLocation::Cells { "CellData" } else { "PointData" }
    }

    fn offsets(self) -> &'static str {
        if self == FieldLocation::Cells { "CellDataOffsets" } else { "PointDataOffsets" }
    }
}

impl VtkBlock {
    /// Creates a block without steps; `index` is its number in the collection.
    pub fn create(root: &Group, name: &str, index: usize, points_per_step: usize) -> Result<Self> {
        let group = make_group(root, name)?;
        group.new_attr::<i64>().shape(2).create("Version")?.write_raw(&[2_i64, 3])?;
        ascii(&group, "Type", b"PolyData")?;
        number(&group, "Index", index as i64)?;
        create::<f32>(&group, "Points", &[3], points_per_step)?;
        create_table::<i64>(&group, "NumberOfPoints", &[])?;
        for kind in CELLS {
            let cells = make_group(&group, kind)?;
            for name in ["NumberOfCells", "NumberOfConnectivityIds"] {
                create_table::<i64>(&cells, name, &[])?;
            }
            for name in ["Offsets", "Connectivity"] {
                // Polygons are written once, in large arrays.
                match kind {
                    "Polygons" => create::<i64>(&cells, name, &[], 4 * points_per_step)?,
                    _ => create_table::<i64>(&cells, name, &[])?,
                }
            }
            append(&cells, "Offsets", &[0_i64])?;
        }
        let steps = make_group(&group, "Steps")?;
        number(&steps, "NSteps", 0_i64)?;
        create_table::<f64>(&steps, "Values", &[])?;
        for name in ["PartOffsets", "NumberOfParts", "PointOffsets"] {
            create_table::<i64>(&steps, name, &[])?;
        }
        for name in ["CellOffsets", "ConnectivityIdOffsets"] {
            create_table::<i64>(&steps, name, &[4])?;
        }
        for on in [FieldLocation::Cells, FieldLocation::Points] {
            make_group(&group, on.data())?;
            make_group(&steps, on.offsets())?;
        }
        Ok(Self { group, steps })
    }

    /// Opens an existing block.
    pub fn open(root: &Group, name: &str) -> Result<Self> {
        let group = root.group(name)?;
        Ok(Self { steps: group.group("Steps")?, group })
    }

    /// Returns the names of the blocks of a collection, in their order.
    pub fn names(root: &Group) -> Result<Vec<String>> {
        let mut names = vec![];
        for group in root.groups()? {
            if let Ok(index) = group.attr("Index") {
                let name = group.name().rsplit('/').next().unwrap_or_default().to_string();
                names.push((index.read_scalar::<i64>()?, name));
            }
        }
        names.sort();
        Ok(names.into_iter().map(|(_, name)| name).collect())
    }

    /// Declares an array of `width` numbers per row.
    pub fn declare<T: hdf5::H5Type>(
        &self,
        on: FieldLocation,
        name: &str,
        width: usize,
        rows_per_step: usize,
    ) -> Result<()> {
        let tail = if width == 1 { vec![] } else { vec![width] };
        create::<T>(&self.group.group(on.data())?, name, &tail, rows_per_step)?;
        create_table::<i64>(&self.steps.group(on.offsets())?, name, &[])
    }

    /// Writes the polygons of all steps, with the number of their points.
    pub fn set_polygons(&self, points: usize, starts: &[i64], corners: &[i64]) -> Result<()> {
        append(&self.group, "NumberOfPoints", &[points as i64])?;
        let polygons = self.group.group("Polygons")?;
        append(&polygons, "Offsets", &starts[1..])?;
        append(&polygons, "Connectivity", corners)?;
        for kind in CELLS {
            let cells = self.group.group(kind)?;
            let counts = match kind {
                "Polygons" => [starts.len() as i64 - 1, corners.len() as i64],
                _ => [0, 0],
            };
            append(&cells, "NumberOfCells", &counts[..1])?;
            append(&cells, "NumberOfConnectivityIds", &counts[1..])?;
        }
        Ok(())
    }

    /// Writes data that are equal in all steps.
    pub fn set_constant<T: hdf5::H5Type>(
        &self,
        on: FieldLocation,
        name: &str,
        values: &[T],
    ) -> Result<()> {
        let data = self.group.group(on.data())?;
        append_portion(&data, name, values)?;
        data.dataset(name)?.new_attr::<u8>().create(CONSTANT)?.write_scalar(&1_u8)
    }

    /// Adds the points of a step. With `own_part` their number may change, and each is a vertex.
    pub fn add_points(&self, points: &[[f32; 3]], own_part: bool) -> Result<()> {
        let first = append_portion(&self.group, "Points", points.as_flattened())?;
        append(&self.steps, "PointOffsets", &[first as i64])?;
        let part = if own_part { self.add_vertices(points.len())? } else { 0 };
        append(&self.steps, "PartOffsets", &[part as i64])?;
        append(&self.steps, "NumberOfParts", &[1_i64])?;
        append(&self.steps, "CellOffsets", &[0_i64; 4])?;
        append(&self.steps, "ConnectivityIdOffsets", &[0_i64; 4]).map(drop)
    }

    /// Extends the list of vertices 0, 1, 2 …, which all steps share, to the largest number of points.
    fn add_vertices(&self, count: usize) -> Result<usize> {
        let part = append(&self.group, "NumberOfPoints", &[count as i64])?;
        for kind in CELLS {
            let cells = self.group.group(kind)?;
            let number = if kind == "Vertices" { count as i64 } else { 0 };
            append(&cells, "NumberOfCells", &[number])?;
            append(&cells, "NumberOfConnectivityIds", &[number])?;
        }
        let vertices = self.group.group("Vertices")?;
        let known = vertices.dataset("Connectivity")?.shape()[0];
        if count > known {
            let ids: Vec<i64> = (known as i64..=count as i64).collect();
            append(&vertices, "Connectivity", &ids[..ids.len() - 1])?;
            append(&vertices, "Offsets", &ids[1..])?;
        }
        Ok(part)
    }

    /// Adds the values of a step to an array.
    pub fn add<T: hdf5::H5Type>(&self, on: FieldLocation, name: &str, values: &[T]) -> Result<()> {
        let first = append_portion(&self.group.group(on.data())?, name, values)?;
        self.refer(on, name, first)
    }

    /// Adds a step to a constant array.
    pub fn again(&self, on: FieldLocation, name: &str) -> Result<()> {
        self.refer(on, name, 0)
    }

    fn refer(&self, on: FieldLocation, name: &str, first: usize) -> Result<()> {
        append(&self.steps.group(on.offsets())?, name, &[first as i64]).map(drop)
    }

    /// Completes a step, which viewers see after [`VtkBlock::show`].
    pub fn end_step(&self, time: f64) -> Result<()> {
        append(&self.steps, "Values", &[time]).map(drop)
    }

    /// Publishes all steps to viewers.
    pub fn show(&self) -> Result<()> {
        let steps = self.steps.dataset("Values")?.shape()[0];
        self.steps.attr("NSteps")?.write_scalar(&(steps as i64))
    }

    /// Removes all steps from number `steps` on.
    pub fn truncate(&self, steps: usize) -> Result<()> {
        for on in [FieldLocation::Cells, FieldLocation::Points] {
            let (data, offsets) = (self.group.group(on.data())?, self.steps.group(on.offsets())?);
            for name in offsets.member_names()? {
                let constant = data.dataset(&name)?.attr(CONSTANT).is_ok();
                let first = self.first_row(&offsets.dataset(&name)?, steps)?;
                if let (Some(first), false) = (first, constant) {
                    truncate(&data, &name, first)?;
                }
                truncate(&offsets, &name, steps)?;
            }
        }
        if let Some(first) = self.first_row(&self.steps.dataset("PointOffsets")?, steps)? {
            truncate(&self.group, "Points", first)?;
        }
        let part = self.first_row(&self.steps.dataset("PartOffsets")?, steps)?;
        if let (Some(part), false) = (part, self.has_polygons()?) {
            self.truncate_parts(part)?;
        }
        for name in ["Values", "PartOffsets", "NumberOfParts", "PointOffsets"] {
            truncate(&self.steps, name, steps)?;
        }
        for name in ["CellOffsets", "ConnectivityIdOffsets"] {
            truncate(&self.steps, name, steps)?;
        }
        self.show()
    }

    fn truncate_parts(&self, parts: usize) -> Result<()> {
        truncate(&self.group, "NumberOfPoints", parts)?;
        for kind in CELLS {
            let cells = self.group.group(kind)?;
            truncate(&cells, "NumberOfCells", parts)?;
            truncate(&cells, "NumberOfConnectivityIds", parts)?;
        }
        Ok(())
    }

    fn has_polygons(&self) -> Result<bool> {
        Ok(self.group.dataset("Polygons/Offsets")?.shape()[0] > 1)
    }

    fn first_row(&self, offsets: &Dataset, step: usize) -> Result<Option<usize>> {
        if step >= offsets.shape()[0] {
            return Ok(None);
        }
        Ok(read::<i64>(offsets, step..step + 1)?.first().map(|&row| row.max(0) as usize))
    }
}

/// Creates the collection of the blocks, and the tree by which viewers list them.
pub(crate) fn create_root(file: &hdf5::File) -> Result<Group> {
    let ordered = |name: &str, parent: &Group| {
        let builder = parent.create_group_builder().obj_track_times(false);
        builder.with_gcpl(|p| p.link_creation_order(LinkCreationOrder::Indexed)).create(name)
    };
    let root = ordered("VTKHDF", file)?;
    root.new_attr::<i64>().shape(2).create("Version")?.write_raw(&[2_i64, 3])?;
    // Not PartitionedDataSetCollection, which pyvista cannot read.
    ascii(&root, "Type", b"MultiBlockDataSet")?;
    ordered("Assembly", &root)?;
    Ok(root)
}

/// Adds a block to the tree.
pub(crate) fn link(root: &Group, name: &str) -> Result<()> {
    root.group("Assembly")?.link_soft(&format!("/VTKHDF/{name}"), name)
}

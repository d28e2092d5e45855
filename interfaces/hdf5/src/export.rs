//! Export of results to files without HDF5: VTK XML for viewers, CSV for tables.
//!
//! Reads: a results file. Writes: `BLOCK_NNNN.vtp` per frame, `frames.pvd` that lists them over time,
//! `NAME.csv` per table. Source of the format: VTK file formats, "PolyData" (docs.vtk.org).

use crate::error::{Result, io};
use crate::replace;
use crate::results::{BlockFrame, FieldArray, ResultsReader, ResultsTable, is_block};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Name of the file that lists the frames over time.
const LIST: &str = "frames.pvd";

/// Writes everything in `results` to `folder`, which is created if necessary; returns the files.
pub fn export(results: impl AsRef<Path>, folder: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    let (reader, folder) = (ResultsReader::open(results)?, folder.as_ref());
    std::fs::create_dir_all(folder).map_err(io(folder, "create the folder"))?;
    let earlier = listed(folder);
    let mut files = frames(&reader, folder)?;
    for stale in earlier.iter().map(|name| folder.join(name)).filter(|path| !files.contains(path)) {
        // Otherwise a reader of file names would show two runs as one, and a reader of the list nothing.
        let _ = std::fs::remove_file(stale);
    }
    for name in reader.table_names()? {
        files.push(write(folder, &format!("{name}.csv"), csv(&reader.table(&name)?))?);
    }
    Ok(files)
}

/// Returns the frames that an earlier export to the folder listed, and the list; nothing for a list of another program.
fn listed(folder: &Path) -> Vec<String> {
    let list = std::fs::read_to_string(folder.join(LIST)).unwrap_or_default();
    let names = list.split("file=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let names: Vec<String> = names.map(String::from).collect();
    if names.is_empty() || !names.iter().all(|name| is_frame(name)) {
        return Vec::new();
    }
    names.into_iter().chain([LIST.into()]).collect()
}

/// Returns true if a file has the name of an exported frame: a block and a number.
fn is_frame(name: &str) -> bool {
    let parts = name.strip_suffix(".vtp").and_then(|stem| stem.rsplit_once('_'));
    parts.is_some_and(|(block, number)| {
        is_block(block) && number.len() >= 4 && number.bytes().all(|byte| byte.is_ascii_digit())
    })
}

fn write(folder: &Path, name: &str, content: String) -> Result<PathBuf> {
    let path = folder.join(name);
    replace::exchange(&path, content.as_bytes())?;
    Ok(path)
}

fn frames(reader: &ResultsReader, folder: &Path) -> Result<Vec<PathBuf>> {
    let (blocks, mut files) = (reader.blocks()?, vec![]);
    let mut list = String::new();
    for (frame, time) in reader.times()?.into_iter().enumerate() {
        for (part, block) in blocks.iter().enumerate() {
            let name = format!("{block}_{frame:04}.vtp");
            files.push(write(folder, &name, vtp(&reader.block(block, frame)?))?);
            let _ = writeln!(
                list,
                "<DataSet timestep=\"{time}\" part=\"{part}\" name=\"{block}\" file=\"{name}\"/>"
            );
        }
    }
    if !files.is_empty() {
        let pvd = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\">\n<Collection>\n\
             {list}</Collection>\n</VTKFile>\n"
        );
        files.push(write(folder, LIST, pvd)?);
    }
    Ok(files)
}

/// Returns one piece of PolyData: polygons, or a vertex per point without polygons.
fn vtp(block: &BlockFrame) -> String {
    let points = block.points.len();
    let polygons = block.polygon_ends.len();
    let (vertices, ids): (usize, Vec<i64>) =
        if polygons > 0 { (0, vec![]) } else { (points, (0..points as i64).collect()) };
    let ends: Vec<i64> = ids.iter().map(|i| i + 1).collect();
    let mut xml = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" \
         byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n<Piece \
         NumberOfPoints=\"{points}\" NumberOfVerts=\"{vertices}\" NumberOfLines=\"0\" \
         NumberOfStrips=\"0\" NumberOfPolys=\"{polygons}\">\n<Points>\n"
    );
    floats(&mut xml, "Points", 3, block.points.as_flattened());
    xml.push_str("</Points>\n<Verts>\n");
    integers(&mut xml, "connectivity", &ids);
    integers(&mut xml, "offsets", &ends);
    xml.push_str("</Verts>\n<Polys>\n");
    integers(&mut xml, "connectivity", &block.corners);
    integers(&mut xml, "offsets", &block.polygon_ends);
    xml.push_str("</Polys>\n<CellData>\n");
    arrays(&mut xml, &block.cell_data);
    xml.push_str("</CellData>\n<PointData>\n");
    arrays(&mut xml, &block.point_data);
    xml.push_str("</PointData>\n</Piece>\n</PolyData>\n</VTKFile>\n");
    xml
}

fn arrays(xml: &mut String, arrays: &[FieldArray]) {
    for array in arrays {
        floats(xml, &array.name, array.width, &array.values);
    }
}

fn floats(xml: &mut String, name: &str, width: usize, values: &[f32]) {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    data_array(xml, "Float32", name, width, bytes);
}

fn integers(xml: &mut String, name: &str, values: &[i64]) {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    data_array(xml, "Int64", name, 1, bytes);
}

/// Encodes the number of bytes and the bytes as one base64 text.
fn data_array(xml: &mut String, kind: &str, name: &str, width: usize, bytes: Vec<u8>) {
    let mut block = (bytes.len() as u64).to_le_bytes().to_vec();
    block.extend(bytes);
    let text = STANDARD.encode(block);
    let _ = writeln!(
        xml,
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{width}\" \
         format=\"binary\">{text}</DataArray>"
    );
}

/// Writes columns as `name [unit]`, and numbers in the shortest form with the same bits.
fn csv(table: &ResultsTable) -> String {
    let mut text = String::from("step");
    for (name, unit) in &table.columns {
        let heading = if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") };
        text.push(',');
        text.push_str(&quoted(&heading));
    }
    text.push('\n');
    for (step, row) in table.steps.iter().zip(table.rows.chunks(table.columns.len().max(1))) {
        let _ = write!(text, "{step}");
        for value in row {
            let _ = write!(text, ",{value}");
        }
        text.push('\n');
    }
    text
}

/// Quotes a cell of a CSV file (RFC 4180).
pub fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.into()
    }
}

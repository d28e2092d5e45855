//! 3D view of a run for a page: the true polyhedra of its frames, turned and played in the browser.
//!
//! Reads: model, frames. Writes: canvas, controls, data and script in one piece of HTML, which needs nothing from outside.
//! Cost: 28 bytes per body and frame.

use crate::plot::escaped;
use crate::source::ReportFrame;
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Vec3};
use ballast::model::{Model, Part, Role};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::json;

/// Shows [`SceneView`]s.
const SCRIPT: &str = include_str!("scene_view.js");
/// Maximum number of frames in a view.
const MAX_FRAMES: usize = 60;
/// Maximum number of poses in a view; frames are left out above.
const MAX_POSES: usize = 400_000;

/// 3D view of a run.
pub struct SceneView<'a> {
    pub model: &'a Model,
    /// Frames in order of time; equally spaced ones of them are shown, the first and the last always.
    pub frames: &'a [ReportFrame],
    /// Inner size of the box, m.
    pub size: Vec3,
    /// Displacement since the first frame from which stones have the last shade, mm.
    pub high: f64,
}

/// Convex body of the view: a grain, or a part of a driven body.
struct SceneItem {
    shape: u32,
    kind: u32,
    body: usize,
    /// Pose in the frame of the body.
    pose: Pose,
}

impl SceneView<'_> {
    /// Returns the view as HTML.
    pub fn html(&self) -> String {
        let frames = self.shown_frames();
        let data = json!({
            "size": self.size.as_slice(),
            "high": self.high,
            "frames": frames.iter().map(|f| format!("{:.3} s, {}", f.time, f.phase.name())).collect::<Vec<_>>(),
            "shapes": self.model.shapes.iter().map(|s| [s.vertices.len(), triangles(s).count()]).collect::<Vec<_>>(),
            "corners": packed(self.model.shapes.iter().flat_map(|s| &s.vertices).flat_map(floats)),
            "triangles": packed(self.model.shapes.iter().flat_map(triangles).flatten().map(u16::to_le_bytes)),
            "items": packed(self.items().iter().flat_map(|i| [i.shape, i.kind]).map(u32::to_le_bytes)),
            "poses": packed(frames.iter().flat_map(|f| self.poses(f))),
        });
        let last = frames.len().saturating_sub(1);
        // Base64 and numbers have no `<`, which could end the script.
        let data = data.to_string().replace('<', "\\u003c");
        format!(
            "<div class=\"scene\"><canvas aria-label=\"{}\"></canvas><div class=\"controls\">\
             <button type=\"button\">Play</button>\
             <label>time <input type=\"range\" min=\"0\" max=\"{last}\" value=\"{last}\"></label>\
             <label>cut away <input type=\"range\" min=\"0\" max=\"1\" step=\"0.01\" value=\"0\"></label>\
             <output></output></div>\n<script>{SCRIPT}showScene({data}, document.currentScript.parentElement);</script></div>",
            escaped(&format!("{} stones in 3D", self.model.grains.len())),
        )
    }

    fn shown_frames(&self) -> Vec<&ReportFrame> {
        let most = (MAX_POSES / self.items().len().max(1)).clamp(2, MAX_FRAMES);
        let count = self.frames.len().min(most);
        let chosen = |k: usize| k * (self.frames.len() - 1) / (count - 1).max(1);
        (0..count).map(|k| &self.frames[chosen(k)]).collect()
    }

    /// Returns grains, then parts of tines (kind 1), sleepers and plates (kind 2).
    fn items(&self) -> Vec<SceneItem> {
        let model = self.model;
        let grain = |(body, shape): (usize, &u32)| SceneItem {
            shape: *shape,
            kind: 0,
            body,
            pose: Pose::identity(),
        };
        let mut items: Vec<SceneItem> = model.grains.shape.iter().enumerate().map(grain).collect();
        for (body, driven) in (model.grains.len()..).zip(&model.driven) {
            let kind = match driven.role {
                Role::Tine => 1,
                Role::Sleeper | Role::Plate => 2,
                Role::Boundary => continue,
            };
            items.extend(driven.parts.iter().filter_map(|part| match part {
                Part::Convex { shape, pose } => {
                    Some(SceneItem { shape: *shape, kind, body, pose: *pose })
                }
                _ => None,
            }));
        }
        items
    }

    /// Returns position and quaternion of each item as bytes.
    fn poses(&self, frame: &ReportFrame) -> Vec<[u8; 4]> {
        let pose = |item: &SceneItem| {
            let Pose { position: p, orientation: q } = frame.poses[item.body].then(&item.pose);
            [p.x, p.y, p.z, q.i, q.j, q.k, q.w].map(|value| (value as f32).to_le_bytes())
        };
        self.items().iter().flat_map(pose).collect()
    }
}

/// Returns the faces of a shape as fans of triangles.
fn triangles(shape: &Polyhedron) -> impl Iterator<Item = [u16; 3]> + '_ {
    (0..shape.face_count()).flat_map(|f| {
        let face = shape.face(f);
        face[1..].windows(2).map(|pair| [face[0], pair[0], pair[1]])
    })
}

fn floats(v: &Vec3) -> [[u8; 4]; 3] {
    [v.x, v.y, v.z].map(|value| (value as f32).to_le_bytes())
}

/// Returns numbers as Base64.
fn packed<const N: usize>(numbers: impl Iterator<Item = [u8; N]>) -> String {
    STANDARD.encode(numbers.flatten().collect::<Vec<u8>>())
}

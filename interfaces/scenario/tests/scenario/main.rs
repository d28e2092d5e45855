//! Tests of case files, samples and schema through the public interface.

mod broken;
mod cases;
mod contacts;
mod content_key;
mod hostile;
mod notation;
mod plates;
mod samples;
mod schema;
mod stones;
mod tools;

/// Valid case, which the tests change.
pub const BASE: &str = r#"name = "base"

[bed]
size_m = [0.60, 0.70, 0.45]
sleeper_underside_z_m = 0.28
density_kg_per_m3 = 2700

[bed.grains]
classes = [{ size_m = 0.025, number_fraction = 0.7 }, { size_m = 0.05, number_fraction = 0.3 }]
vertices = [8, 40]

[bed.preparation]
step_s = 1e-3

[sleepers]
blocks = [{ size_m = [0.29, 0.40, 0.15] }]
tamped = [1]

[tines]
y_offsets_m = [-0.1, 0.1]
gap_to_sleeper_m = 0.06

[tamping]
insertion = { duration_s = 0.45, depth_m = 0.018 }
squeeze = { stroke_m = 0.05, force_limit_N = 7800 }
vibration = { frequency_Hz = 35, amplitude_m = 0.005 }

[run]
duration_s = 1.764
step_s = 8e-4
restitution = 0

[solver]
schedule = "synchronous"
partition = { method = "boxes", boxes = [2, 1, 1] }
max_iterations = 300
tolerance = 1.666e-4
"#;

/// Returns [`BASE`] with `from`, which must occur once, replaced by `to`.
pub fn changed(from: &str, to: &str) -> String {
    assert_eq!(BASE.matches(from).count(), 1, "{from:?} is not unique in the base");
    BASE.replacen(from, to, 1)
}

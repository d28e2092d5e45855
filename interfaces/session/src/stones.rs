//! Shape and grading of stones as text and JSON.

use crate::quantities::Quantity;
use ballast::observe::{EN_13450_SIEVES, MassWeightedMean, StoneStatistics};
use serde_json::{Map, Value, json};

/// Means of descriptors with their names, and the factor to the unit of the names.
fn means(stones: &StoneStatistics) -> [(Quantity, MassWeightedMean, f64); 4] {
    [
        (Quantity::StoneElongation, stones.elongation, 1.0),
        (Quantity::StoneFlatness, stones.flatness, 1.0),
        (Quantity::StoneSphericity, stones.sphericity, 1.0),
        (Quantity::StoneAngularity, stones.angularity, 1f64.to_degrees()),
    ]
}

/// Indices of the standards with their names.
fn indices(stones: &StoneStatistics) -> [(Quantity, f64); 2] {
    [(Quantity::FlakinessIndex, stones.flakiness_index), (Quantity::ShapeIndex, stones.shape_index)]
}

/// Converts shape and grading of stones to JSON.
pub fn stones_json(stones: &StoneStatistics) -> Value {
    let mut value = Map::new();
    for (quantity, MassWeightedMean { mean, deviation }, factor) in means(stones) {
        let entry = json!({ "mean": factor * mean, "standard_deviation": factor * deviation });
        value.insert(quantity.key().into(), entry);
    }
    for (quantity, share) in indices(stones) {
        value.insert(quantity.key().into(), json!(share));
    }
    let points = EN_13450_SIEVES.iter().zip(&stones.passing);
    let grading: Vec<Value> =
        points.map(|(sieve, passing)| json!({ "sieve_m": sieve, "passing": passing })).collect();
    value.insert(Quantity::StoneGrading.key().into(), grading.into());
    value.into()
}

/// Returns lines of text with shape and grading of stones.
pub fn stones_text(stones: &StoneStatistics) -> String {
    let means = means(stones).map(|(quantity, MassWeightedMean { mean, deviation }, factor)| {
        let unit = if factor == 1.0 { "" } else { "°" };
        let digits = if factor == 1.0 { 2 } else { 0 };
        let (mean, deviation) = (factor * mean, factor * deviation);
        format!("{} {mean:.digits$} ± {deviation:.digits$}{unit}", quantity.label())
    });
    let indices = indices(stones)
        .map(|(quantity, share)| format!("{} {:.1} %", quantity.label(), 100.0 * share));
    let points = EN_13450_SIEVES.iter().zip(&stones.passing);
    let grading: Vec<String> = points
        .map(|(sieve, passing)| format!("{:.1} mm {:.0} %", 1e3 * sieve, 100.0 * passing))
        .collect();
    format!(
        "stones    {}\n          {}\n{}   {}",
        means.join(", "),
        indices.join(", "),
        Quantity::StoneGrading.label(),
        grading.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stones() -> StoneStatistics {
        let mean = |mean| MassWeightedMean { mean, deviation: 0.05 };
        StoneStatistics {
            elongation: mean(0.7),
            flatness: mean(0.65),
            sphericity: mean(0.8),
            angularity: MassWeightedMean { mean: std::f64::consts::FRAC_PI_3, deviation: 0.1 },
            flakiness_index: 0.11,
            shape_index: 0.152,
            passing: [0.02, 0.2, 0.5, 0.85, 1.0, 1.0],
        }
    }

    #[test]
    fn text_and_json_have_the_names_of_the_table() {
        let text = stones_text(&stones());
        for part in [
            "elongation I/L 0.70 ± 0.05",
            "sphericity 0.80 ± 0.05",
            "angularity 60 ± 6°",
            "flakiness index 11.0 %",
            "shape index 15.2 %",
            "passing   22.4 mm 2 %, 31.5 mm 20 %",
        ] {
            assert!(text.contains(part), "{part:?} in {text}");
        }
        let value = stones_json(&stones());
        assert_eq!(value["flatness"]["mean"], 0.65);
        assert_eq!(value["shape_index"], 0.152);
        assert_eq!(value["grading"][3], json!({ "sieve_m": 0.05, "passing": 0.85 }));
    }
}

//! The squeeze of each tine pair, from the table of steps.
//!
//! Closing is what the tines did, mean over a vibration period, so loops are those of the tools, whoever moved
//! them. Contract: the meter is that of the core.

use crate::record::{Followed, Row};
use crate::statistics::MovingMean;
use ballast::math::Vec3;
use ballast::observe::{SqueezeMeter, SqueezeRecord};
use ballast::step::{Reaction, StepReport};
use ballast::track::TampingPhase;
use ballast::track::plan::Plan;
use std::collections::BTreeMap;

/// Force above which the ballast counts as touched, N.
pub const TOUCHED: f64 = 50.0;

/// A pair of tines and its squeeze.
#[derive(Debug, Clone, PartialEq)]
pub struct Squeeze {
    /// Names of the tines.
    pub name: String,
    pub record: SqueezeRecord,
    /// Simulated time at which the squeeze began, s.
    pub start: f64,
}

/// The squeezes of a run; none without tines or if it did not get that far.
pub fn squeezes(
    plan: &Plan,
    followed: &[Followed],
    rows: &[Row],
    period: usize,
) -> ballast::Result<Vec<Squeeze>> {
    let mut pairs: BTreeMap<u32, Vec<(usize, f64)>> = BTreeMap::new();
    for tine in &plan.tines {
        if let Some(at) = followed.iter().position(|f| f.name == tine.name) {
            pairs.entry(tine.pair).or_default().push((at, tine.direction));
        }
    }
    let pairs: Vec<_> = pairs.into_values().collect();
    let first = rows.iter().position(|row| row.phase() == TampingPhase::Squeeze);
    let Some(first) = first.filter(|_| !pairs.is_empty()) else { return Ok(vec![]) };
    let window = u32::try_from(period).unwrap_or(u32::MAX).max(1);
    let mut meter = SqueezeMeter::new(pairs.clone(), window, TOUCHED)?;
    // Where each tine is in the mean; the period before the squeeze tells where it started from.
    let mut means = vec![MovingMean::new(period); followed.len()];
    let mut mean = vec![[0.0; 3]; followed.len()];
    let mut origin = mean.clone();
    let mut before = 0.0;
    for (k, row) in rows.iter().enumerate() {
        let time = row.get(crate::record::Column::Time);
        let h = time - before;
        before = time;
        for (i, place) in means.iter_mut().enumerate() {
            mean[i] = place.take(row.place(i)).unwrap_or(row.place(i));
        }
        if k < first {
            origin.clone_from(&mean);
            continue;
        }
        if !matches!(row.phase(), TampingPhase::Squeeze | TampingPhase::Hold) {
            break;
        }
        let reaction = |i: usize| Reaction {
            impulse: Vec3::from(row.force(i)) * h,
            work: row.work(i),
            ..Reaction::default()
        };
        let reactions = (0..followed.len()).map(reaction).collect();
        let closing: Vec<f64> = (pairs.iter())
            .map(|pair| {
                let way = |&(i, direction): &(usize, f64)| direction * (mean[i][0] - origin[i][0]);
                pair.iter().map(way).sum::<f64>() / pair.len() as f64
            })
            .collect();
        meter.record(&StepReport { reactions, ..StepReport::default() }, &closing, h)?;
    }
    let start = rows[first].get(crate::record::Column::Time);
    let named = |pair: &Vec<(usize, f64)>| {
        let names: Vec<&str> = pair.iter().map(|t| followed[t.0].name.as_str()).collect();
        names.join(" and ")
    };
    let records = meter.records().iter().cloned();
    let all = pairs.iter().zip(records);
    Ok(all.map(|(pair, record)| Squeeze { name: named(pair), record, start }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case;
    use crate::console::Console;
    use crate::record::columns;
    use ballast::model::Role;

    /// Tines that squeeze with 100 N each while they close by 0.1 m/s, from 10 ms on, for 40 ms.
    fn rows(followed: &[Followed]) -> Vec<Row> {
        let names = columns(followed);
        let at = |name: &str| names.iter().position(|n| n.0 == name).unwrap();
        let row = |k: usize| {
            let mut row = vec![0.0; names.len()];
            let since = k.saturating_sub(10) as f64 * 1e-3;
            row[at("time")] = 1e-3 * k as f64;
            row[at("phase")] = if k < 11 { 2.0 } else { 3.0 };
            for (name, sign) in [("tine_1_plus", 1.0), ("tine_1_minus", -1.0)] {
                row[at(&format!("{name}_x"))] = sign * (0.1 * since - 0.2);
                // The ballast pushes back.
                row[at(&format!("{name}_force_x"))] = -sign * if k < 11 { 0.0 } else { 100.0 };
                row[at(&format!("{name}_work"))] = if k < 11 { 0.0 } else { 100.0 * 1e-4 };
            }
            Row(row)
        };
        (1..=50).map(row).collect()
    }

    #[test]
    fn energy_is_force_times_closing_of_both_sides() {
        let text = include_str!("../../tests/data/tiny.toml").to_string();
        let case =
            case::parse(text, "tiny", &case::Choices::default(), Console { json: false }).unwrap();
        let names = ["sleeper_1", "tine_1_plus", "tine_1_minus"];
        let followed: Vec<Followed> = (names.iter().enumerate())
            .map(|(driven, name)| Followed { name: name.to_string(), role: Role::Tine, driven })
            .collect();
        let found = squeezes(&case.plan, &followed, &rows(&followed), 4).unwrap();
        let [squeeze] = &found[..] else { panic!("{found:?}") };
        let record = &squeeze.record;
        // Means over four steps lag by one and a half.
        assert!((record.closing - 0.1 * (0.040 - 0.0015)).abs() < 1e-9, "{record:?}");
        assert_eq!(record.peak_force, 100.0);
        let [first, last] = [record.loop_points[0][0], record.loop_points.last().unwrap()[0]];
        assert!((record.compaction_energy - 2.0 * 100.0 * (last - first)).abs() < 1e-9);
        assert!((record.work - 40.0 * 2.0 * 0.01).abs() < 1e-9);
        assert_eq!(record.loop_points.len(), 10);
    }
}

//! Content of a unit: the bed as bytes, and the archive.

use crate::driver::{CASE, unpacked};
use ballast::model::{ContactStiffness, Model};
use ballast::state::State;
use ballast_fmu::bed::UnitBed;
use ballast_fmu::package::{FmiVersion, unit_bytes};
use ballast_scenario::CaseOverrides;

fn read_back(bed: &UnitBed) -> UnitBed {
    UnitBed::from_bytes(&bed.to_bytes()).unwrap()
}

#[test]
fn a_bed_is_read_back_to_the_bit() {
    let bed = &unpacked().bed;
    let again = read_back(bed);
    // Without the operands, which have thousands of numbers.
    assert!(again.model == bed.model);
    assert_eq!((&again.case_text, again.overrides), (&bed.case_text, bed.overrides));
    assert!(again.to_bytes() == bed.to_bytes());
}

#[test]
fn rigid_bodies_among_compliant_ones_are_read_back() {
    let mut model = Model::clone(&unpacked().bed.model);
    let stiffness = ContactStiffness { normal: 1e7, tangential_ratio: 0.8, damping_time: 0.0 };
    model.grain_stiffness = stiffness;
    model.restitution = 0.0;
    model.driven[0].stiffness = stiffness;
    let state = State::clone(&unpacked().bed.state);
    let bed = UnitBed::new(model, state, CASE.into(), CaseOverrides::default()).unwrap();
    assert!(bed.model.driven[1].stiffness.is_rigid());
    assert!(read_back(&bed).model == bed.model);
}

#[test]
fn equal_beds_give_equal_archives() {
    let bed = &unpacked().bed;
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let archive = unit_bytes(bed, b"library", version).unwrap();
        assert!(archive.starts_with(b"PK"));
        assert!(unit_bytes(&read_back(bed), b"library", version).unwrap() == archive);
    }
}

//! Every file of ours tells what it is.

use crate::scene;
use ballast_hdf5::checkpoint::write;
use ballast_hdf5::inspect::inspect;
use ballast_hdf5::results::{Meta, Writer};
use ballast_hdf5::{Error, state_hash};

#[test]
fn checkpoints_and_results_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.h5"), folder.path().join("b.h5"));
    let checkpoint = scene::checkpoint();
    write(&a, &checkpoint).unwrap();
    let told = inspect(&a).unwrap();
    assert_eq!((told.kind, told.grains, told.driven.len()), ("run", 27, 4));
    assert_eq!(told.hash, Some(state_hash(&checkpoint.model, &checkpoint.state)));
    assert_eq!(told.to_json()["case_name"], "Stück");
    assert!(told.to_string().contains("time      6148914691.236517 s, step 12345"), "{told}");

    let meta = Meta { case_name: "other".into(), ..Meta::default() };
    let mut writer = Writer::create(&b, &checkpoint.model, &meta).unwrap();
    writer.series("solver", &[("iterations", "")]).unwrap();
    writer.append("solver", 1, &[3.0]).unwrap();
    writer.close().unwrap();
    let told = inspect(&b).unwrap();
    assert_eq!((told.kind, told.frames, told.step), ("results", Some(0), None));
    assert_eq!(told.series, [("solver".to_string(), 1, 1)]);
    assert!(told.to_json().get("hash").is_none());
}

#[test]
fn other_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.h5");
    hdf5::File::create(&path).unwrap();
    assert!(matches!(inspect(&path), Err(Error::Damaged { .. })));
    std::fs::write(&path, "text").unwrap();
    assert!(matches!(inspect(&path), Err(Error::Damaged { .. })));
}

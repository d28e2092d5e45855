//! Summaries of all kinds of files.

use crate::scene;
use ballast_hdf5::checkpoint::write;
use ballast_hdf5::inspect::inspect;
use ballast_hdf5::results::{ResultsMetadata, ResultsWriter};
use ballast_hdf5::{Error, state_hash};

#[test]
fn checkpoints_and_results_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.h5"), folder.path().join("b.h5"));
    let checkpoint = scene::checkpoint();
    write(&a, &checkpoint).unwrap();
    let summary = inspect(&a).unwrap();
    assert_eq!((summary.kind, summary.grains, summary.driven.len()), ("run", 27, 4));
    assert_eq!(summary.hash, Some(state_hash(&checkpoint.model, &checkpoint.state)));
    assert_eq!(summary.to_json()["case_name"], "Stück");
    assert!(summary.to_string().contains("time      6148914691.236517 s, step 12345"), "{summary}");

    let meta = ResultsMetadata { case_name: "other".into(), ..ResultsMetadata::default() };
    let mut writer = ResultsWriter::create(&b, &checkpoint.model, &meta).unwrap();
    writer.table("solver", &[("iterations", "")]).unwrap();
    writer.append("solver", 1, &[3.0]).unwrap();
    writer.close().unwrap();
    let summary = inspect(&b).unwrap();
    assert_eq!((summary.kind, summary.frames, summary.step), ("results", Some(0), None));
    assert_eq!(summary.tables, [("solver".to_string(), 1, 1)]);
    assert!(summary.to_json().get("hash").is_none());
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

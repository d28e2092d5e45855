//! Tests of motions in files of other programs: wrong clocks, static poses, unusable values, long records.

mod common;

use ballast_mcap::motion::{self, RecordedMotion, TimeSource};
use ballast_mcap::{McapWriter, TopicMessage};
use ballast_protocol::messages::{
    Header, Point, Pose, PoseStamped, Quaternion, TFMessage, Transform, TransformStamped, Twist,
    TwistStamped, Vector3,
};
use mcap::records::op;
use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const MS: u64 = 1_000_000;
/// Time of a clock that counts from 1970, ns.
const NOW: u64 = 1_700_000_000_000_000_000;
const TINE: &str = "/tine/pose";
const SLEEPER: &str = "/sleeper/pose";

fn read(path: &Path, time: TimeSource) -> ballast_mcap::Result<RecordedMotion> {
    motion::read(path, &["tine".into(), "sleeper".into()], &[], time, 0)
}

fn refusal(path: &Path) -> String {
    read(path, TimeSource::Stamp).unwrap_err().to_string()
}

fn write(entries: &[TopicMessage]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = McapWriter::create(&path, None).unwrap();
    entries.iter().for_each(|entry| writer.write(entry).unwrap());
    writer.finish().unwrap();
    (folder, path)
}

fn at(x: f64) -> Pose {
    let orientation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
    Pose { position: Point { x, y: 0.0, z: 0.5 }, orientation }
}

fn pose(topic: &str, stamp: u64, log: u64) -> TopicMessage {
    posed(topic, stamp, log, at(1e-12 * (log % NOW) as f64))
}

fn posed(topic: &str, stamp: u64, log: u64, pose: Pose) -> TopicMessage {
    TopicMessage::of(topic, log, &PoseStamped { header: Header::world(stamp), pose }).unwrap()
}

fn twist(topic: &str, stamp: u64, log: u64, x: f64) -> TopicMessage {
    let twist = Twist { linear: Vector3 { x, y: 0.0, z: 0.0 }, ..Twist::default() };
    TopicMessage::of(topic, log, &TwistStamped { header: Header::world(stamp), twist }).unwrap()
}

fn transform(topic: &str, frame: &str, stamp: u64, log: u64, pose: Pose) -> TopicMessage {
    let Point { x, y, z } = pose.position;
    let transform = TransformStamped {
        header: Header::world(stamp),
        child_frame_id: frame.into(),
        transform: Transform { translation: Vector3 { x, y, z }, rotation: pose.orientation },
    };
    TopicMessage::of(topic, log, &TFMessage { transforms: vec![transform] }).unwrap()
}

/// Messages every ms, with the stamp that `stamp` gives for the number of a message.
fn series(topic: &str, stamp: impl Fn(u64) -> u64) -> Vec<TopicMessage> {
    (0..100).map(|i| pose(topic, stamp(i), NOW + i * MS)).collect()
}

fn good(topic: &str) -> Vec<TopicMessage> {
    series(topic, |i| NOW + i * MS)
}

#[test]
fn stamps_that_jump_for_years_are_refused() {
    let first = |i| if i == 0 { 0 } else { NOW + i * MS };
    let middle = |i| if i < 50 { i * MS } else { NOW + i * MS };
    let ahead = |i| if i < 50 { NOW + i * MS } else { NOW + NOW / 5 + i * MS };
    let unset = |i| if i == 70 { 0 } else { NOW + i * MS };
    let jumps: [&dyn Fn(u64) -> u64; 4] = [&first, &middle, &ahead, &unset];
    for (stamp, jump_at) in jumps.into_iter().zip([1, 50, 50, 0]) {
        for entries in [
            series(TINE, stamp),
            [series(TINE, stamp), series(SLEEPER, stamp)].concat(),
            [series(TINE, stamp), good(SLEEPER)].concat(),
        ] {
            let (_folder, path) = write(&entries);
            let said = refusal(&path);
            let place =
                format!("/pose at {} ns, stamp: expected at most 600 s", NOW + jump_at * MS);
            assert!(said.contains(&place) && said.contains("--time log"), "{said}");
            let motion = read(&path, TimeSource::Log).unwrap();
            assert_eq!((motion.end_ns, motion.warnings), (99 * MS, vec![]));
        }
    }
    // Only the twists, two messages, and transforms.
    let twists = (0..100).map(|i| twist("/tine/twist", first(i), NOW + i * MS, 0.0));
    let (_folder, path) = write(&[good(TINE), twists.collect()].concat());
    assert!(refusal(&path).contains("/tine/twist at"), "{}", refusal(&path));
    let (_folder, path) = write(&[pose(TINE, 0, NOW), pose(TINE, NOW, NOW + MS)]);
    assert!(refusal(&path).contains("--time log"));
    let tf = (0..9).map(|i| transform("/tf", "tine", first(i), NOW + i * MS, at(i as f64)));
    let (_folder, path) = write(&tf.collect::<Vec<_>>());
    assert!(refusal(&path).contains("/tf:tine at"), "{}", refusal(&path));
}

#[test]
fn long_times_without_a_pose_are_refused_with_their_place() {
    // The recording has them, too.
    let entries = |topic, late: u64| (0..9).map(move |i| (topic, i * MS + late * (i / 5)));
    let (_folder, path) =
        write(&entries(TINE, 3600 * 1000 * MS).map(|(t, at)| pose(t, at, at)).collect::<Vec<_>>());
    for time in [TimeSource::Stamp, TimeSource::Log] {
        let said = read(&path, time).unwrap_err().to_string();
        assert!(said.contains("poses of \"tine\": expected at most 600 s"), "{said}");
        assert!(said.contains("none from 0.004 to 3600.005 s of the file"), "{said}");
    }
    // Outside of the common time they do no harm.
    let short: Vec<_> = (0..5).map(|i| pose(SLEEPER, i * MS, i * MS)).collect();
    let long: Vec<_> = entries(TINE, 3600 * 1000 * MS).map(|(t, at)| pose(t, at, at)).collect();
    let (_folder, path) = write(&[long, short].concat());
    assert_eq!(read(&path, TimeSource::Stamp).unwrap().end_ns, 4 * MS);
    // Stamps of two clocks.
    let (_folder, path) = write(&[good(TINE), series(SLEEPER, |i| i * MS)].concat());
    let said = refusal(&path);
    assert!(said.contains(&format!("\"tine\" from {NOW} ns on, and \"sleeper\"")), "{said}");
    assert!(said.contains("--time log") && read(&path, TimeSource::Log).is_ok(), "{said}");
}

#[test]
fn clocks_that_are_set_are_noticed() {
    let back = |i| NOW + i * MS - if i < 50 { 0 } else { 20 * MS + MS / 3 };
    for entries in [
        series(TINE, back),
        [series(TINE, back), good(SLEEPER)].concat(),
        [good(TINE), series(SLEEPER, back)].concat(),
    ] {
        let (_folder, path) = write(&entries);
        let said = refusal(&path);
        let place = format!("/pose at {} ns, stamp: expected {}", NOW + 50 * MS, NOW + 49 * MS);
        assert!(said.contains(&place) && said.contains("--time log"), "{said}");
        assert_eq!(read(&path, TimeSource::Log).unwrap().warnings, [""; 0]);
    }
    // Single messages may be late, and small jumps ahead are possible.
    let warnings = |stamp: &dyn Fn(u64) -> u64| {
        let (_folder, path) = write(&[good(SLEEPER), series(TINE, stamp)].concat());
        read(&path, TimeSource::Stamp).unwrap().warnings
    };
    assert_eq!(warnings(&|i| NOW + i * MS), [""; 0]);
    let late = warnings(&|i| NOW + if i == 50 { 30 * MS + 7 } else { i * MS });
    let said = "/tine/pose: expected stamps in the order of recording, found 1 earlier";
    assert!(late.len() == 1 && late[0].starts_with(said), "{late:?}");
    let ahead = warnings(&|i| NOW + i * MS + if i < 50 { 0 } else { 37_000 * MS });
    let said = "/tine/pose: expected stamps that advance as the times of recording do";
    assert!(ahead.len() == 1 && ahead[0].starts_with(said), "{ahead:?}");
    // Simulated time at another rate, and a pause that the recording has, too, are no jumps.
    assert_eq!(warnings(&|i| NOW + i * MS / 50), [""; 0]);
    let paused: Vec<_> = (0..99).map(|i| NOW + i * MS + (i / 50) * 9000 * MS).collect();
    let (_folder, path) = write(&paused.iter().map(|t| pose(TINE, *t, *t)).collect::<Vec<_>>());
    assert_eq!(read(&path, TimeSource::Stamp).unwrap().warnings, [""; 0]);
    // Nor are messages that are sent again.
    let again = |i: u64| {
        let sent = [i, i.saturating_sub(5)];
        sent.map(|k| posed(TINE, NOW + k * MS, NOW + i * MS, at(1e-6 * k as f64)))
    };
    let (_folder, path) = write(&(0..100).flat_map(again).collect::<Vec<_>>());
    let motion = read(&path, TimeSource::Stamp).unwrap();
    assert_eq!((motion.inputs[0].waveform.knots.len(), motion.warnings), (100, vec![]));
    // A recorder whose clock was set back leaves no trace but the order of the file.
    let reset: Vec<_> = (0..100).map(|i| pose(TINE, back(i), back(i))).collect();
    let (_folder, path) = write(&reset);
    let warnings = read(&path, TimeSource::Stamp).unwrap().warnings;
    assert!(warnings[0].contains("found 1 recorded before the message ahead"), "{warnings:?}");
}

#[test]
fn a_single_pose_and_a_static_transform_hold_for_all_times() {
    for sleeper in [
        pose(SLEEPER, 0, NOW),
        pose(SLEEPER, NOW + 5000 * MS, NOW + 5000 * MS),
        transform("/tf", "sleeper", NOW, NOW, at(1.0)),
        transform("/tf_static", "sleeper", 0, NOW - MS, at(1.0)),
    ] {
        let (_folder, path) = write(&[vec![sleeper], good(TINE)].concat());
        let motion = read(&path, TimeSource::Stamp).unwrap();
        let [held, moved] = &motion.inputs[..] else { panic!("{motion:?}") };
        assert_eq!((&held.body[..], &moved.body[..], motion.end_ns), ("sleeper", "tine", 99 * MS));
        let knots = &held.waveform.knots;
        assert_eq!([knots[0].time_ns, knots[1].time_ns], [0, 99 * MS]);
        assert!(knots.len() == 2 && knots[0].pose == knots[1].pose);
        let notes = motion.notes.join("\n");
        assert!(notes.contains("sleeper: one pose (/") && notes.contains("holds for all times"));
    }
    // Sent again to a late subscriber, it is the same one; another is none for all times.
    let again = |x| transform("/tf_static", "sleeper", NOW, NOW + 50 * MS, at(x));
    let first = transform("/tf_static", "sleeper", 0, NOW, at(1.0));
    let (_folder, path) = write(&[vec![first.clone(), again(1.0)], good(TINE)].concat());
    assert_eq!(read(&path, TimeSource::Stamp).unwrap().inputs.len(), 2);
    let (_folder, path) = write(&[vec![first.clone(), again(2.0)], good(TINE)].concat());
    let said = "transform of \"sleeper\", pose: expected one for all times, found two that differ";
    assert!(refusal(&path).contains(said), "{}", refusal(&path));
    // A map names its frame; what moves on /tf is not static.
    let map = ["/tf_static:block=sleeper", "/tine/pose=tine"].map(|map| map.parse().unwrap());
    let block = transform("/tf_static", "block", 0, NOW, at(3.0));
    let (_folder, path) = write(&[vec![block], good(TINE)].concat());
    let bodies = ["tine".to_string(), "sleeper".into()];
    let motion = motion::read(&path, &bodies, &map, TimeSource::Stamp, 0).unwrap();
    assert_eq!(motion.inputs[0].waveform.knots[1].pose.position.x, 3.0);
    let moves = (0..100).map(|i| transform("/tf", "sleeper", NOW + i * MS, NOW + i * MS, at(5.0)));
    let (_folder, path) = write(&[vec![first], moves.collect(), good(TINE)].concat());
    let motion = read(&path, TimeSource::Stamp).unwrap();
    assert_eq!(motion.inputs[0].waveform.knots[1].pose.position.x, 5.0);
}

const POSE: &str =
    r#"{"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}"#;

/// Writes messages in JSON.
fn write_json(texts: &[String]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let channel = writer.add_channel(0, TINE, "json", &BTreeMap::new()).unwrap();
    for (i, text) in texts.iter().enumerate() {
        let (log_time, publish_time) = (NOW + i as u64 * MS, 0);
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: 0,
            log_time,
            publish_time,
        };
        writer.write_to_known_channel(&header, text.as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    (folder, path)
}

#[test]
fn unusable_values_are_named_with_topic_time_and_component() {
    let time = NOW + 30 * MS;
    let wrong = |change: fn(&mut Pose)| {
        let mut pose = at(0.0);
        change(&mut pose);
        pose
    };
    let finite = "expected a finite number, found";
    for (entry, said) in [
        (
            posed(TINE, time, time, wrong(|p| p.position.y = f64::NAN)),
            format!("/tine/pose at {time} ns, pose.position.y: {finite} NaN; correct or leave out"),
        ),
        (
            posed(TINE, time, time, wrong(|p| p.orientation.w = f64::INFINITY)),
            format!("/tine/pose at {time} ns, pose.orientation.w: {finite} inf; "),
        ),
        (
            transform("/tf_static", "sleeper", 0, time, wrong(|p| p.position.z = f64::NAN)),
            format!(
                "/tf_static at {time} ns, transform of \"sleeper\", translation.z: {finite} NaN"
            ),
        ),
        (
            twist("/tine/twist", time, time, f64::NAN),
            format!("/tine/twist at {time} ns, twist.linear.x: {finite} NaN; "),
        ),
        (
            posed(TINE, time, time, wrong(|p| p.orientation.w = 0.0)),
            format!("/tine/pose at {time} ns, pose.orientation: expected a unit quaternion"),
        ),
        (
            posed(TINE, time, time, wrong(|p| p.orientation.w = 1.006)),
            "found (0, 0, 0, 1.006) of length 1.006; correct or leave out".into(),
        ),
    ] {
        let (_folder, path) = write(&[good(TINE), vec![entry]].concat());
        assert!(refusal(&path).contains(&said), "{}", refusal(&path));
    }
    for (word, said) in [
        ("NaN", "message: expected JSON, found NaN, which JSON does not have; correct or"),
        ("null", "position.y: expected a number, found null; correct or"),
        ("[", "message: expected JSON, found another text"),
    ] {
        let texts = [POSE.to_string(), POSE.replace("\"y\": 2", &format!("\"y\": {word}"))];
        let (_folder, path) = write_json(&texts);
        let place = format!("/tine/pose at {} ns, {said}", NOW + MS);
        assert!(refusal(&path).contains(&place), "{}", refusal(&path));
    }
}

#[test]
fn quaternions_that_tf2_takes_are_normalised_with_a_note() {
    for (length, noted) in [(1.0, false), (1.0 + 1e-8, false), (1.0016, true), (0.9955, true)] {
        let mut turned = at(0.0);
        turned.orientation.w = length;
        let entries = (0..5).map(|i| posed(TINE, NOW + i * MS, NOW + i * MS, turned));
        let (_folder, path) = write(&entries.collect::<Vec<_>>());
        let motion = read(&path, TimeSource::Stamp).unwrap();
        let norm = motion.inputs[0].waveform.knots[2].pose.orientation.norm();
        assert!((norm - 1.0).abs() < 1e-15, "{norm}");
        let note = format!(
            "tine: 5 quaternions of /tine/pose are normalised; their length differs from 1, at most as {length:.6}"
        );
        assert_eq!(motion.notes.contains(&note), noted, "{:?}", motion.notes);
    }
}

#[test]
fn other_forms_of_bags_are_named_with_their_conversion() {
    let zstd = b"\x28\xb5\x2f\xfd rest";
    let mut packed = pose(TINE, NOW, NOW);
    packed.bytes = zstd.to_vec();
    let (_folder, path) = write(&[good(SLEEPER), vec![packed]].concat());
    let said = refusal(&path);
    let expected =
        format!("/tine/pose at {NOW} ns, message: expected one without compression, found zstd");
    assert!(said.contains(&expected) && said.contains("`ros2 bag convert`"), "{said}");

    for (start, said) in [
        (&zstd[..], "zstd; decompress it with `zstd -d FILE`"),
        (b"\x04\x22\x4d\x18 rest", "lz4; decompress it"),
        (b"\x1f\x8b\x08", "gzip; decompress it"),
        (b"SQLite format 3\0", "`mcap convert FILE.db3 OUT.mcap`"),
        (b"#ROSBAG V2.0\n", "`mcap convert FILE.bag OUT.mcap`"),
    ] {
        std::fs::write(&path, start).unwrap();
        let found = refusal(&path);
        assert!(
            found.contains("start: expected an MCAP file, found") && found.contains(said),
            "{found}"
        );
    }

    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path();
    assert!(refusal(bag).contains("expected a file, found a folder without recordings"));
    for (name, said) in [
        ("metadata.yaml", "found a folder of rosbag2 without recordings"),
        ("bag_0.mcap", "found a folder of rosbag2; use bag_0.mcap in it"),
        (
            "bag_1.mcap.zstd",
            "a folder of rosbag2 with bag_0.mcap, bag_1.mcap.zstd; use one of these",
        ),
    ] {
        std::fs::write(bag.join(name), "").unwrap();
        assert!(refusal(bag).contains(said), "{}", refusal(bag));
    }
}

/// A file with 100 poses, and a record of `length` bytes, most of them a hole, before byte `at` of the rest.
fn with_long_record(path: &Path, whole: &[u8], at: usize, kind: u8, start: &[u8], length: u64) {
    let mut file = std::fs::File::create(path).unwrap();
    file.write_all(&whole[..at]).unwrap();
    file.write_all(&[&[kind][..], &length.to_le_bytes(), start].concat()).unwrap();
    file.seek(SeekFrom::Current((length - start.len() as u64) as i64)).unwrap();
    file.write_all(&whole[at..]).unwrap();
}

#[test]
fn long_records_that_are_not_needed_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let attachment = |name| [&[0; 16][..], &text(name)].concat();
    let records_of = [
        (op::ATTACHMENT, attachment("video.mp4")),
        (op::METADATA, text("notes")),
        (0x90, vec![]),
        // A picture on another topic.
        (op::MESSAGE, vec![0; 22]),
    ];
    for (chunks, summary) in [(true, true), (false, true), (true, false), (false, false)] {
        let options = mcap::WriteOptions::new().use_chunks(chunks).chunk_size(Some(500));
        // The record's message is one more than the statistics say.
        let options = options.emit_statistics(false).emit_summary_offsets(summary);
        let mut writer = options.create(std::fs::File::create(&path).unwrap()).unwrap();
        let schema = writer.add_schema("geometry_msgs/msg/PoseStamped", "ros2msg", b"").unwrap();
        let channel = writer.add_channel(schema, TINE, "cdr", &BTreeMap::new()).unwrap();
        for (i, entry) in good(TINE).iter().enumerate() {
            let (log_time, publish_time) = (entry.time_ns, entry.time_ns);
            let (channel_id, sequence) = (channel, i as u32);
            let header =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &entry.bytes).unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        let (mut begins, end) = common::records(&whole);
        begins.push(end);
        // At the beginning, in the middle and at the end; an index of messages follows its chunk.
        let middle = begins[begins.len() / 2..].iter().find(|at| whole[**at] != op::MESSAGE_INDEX);
        for (kind, start) in &records_of {
            for at in [begins[1], *middle.unwrap(), begins[begins.len() - 1]] {
                for length in [300_000_000, 1 << 33] {
                    with_long_record(&path, &whole, at, *kind, start, length);
                    let motion = read(&path, TimeSource::Stamp).unwrap();
                    let knots = motion.inputs[0].waveform.knots.len();
                    assert_eq!((knots, motion.truncation), (100, None), "{kind} at {at}");
                }
            }
        }
        // The end of the file within such a record is one like any other.
        let last = begins[begins.len() - 1];
        with_long_record(&path, &whole[..last], last, 0x90, &[], 300_000_000);
        let motion = read(&path, TimeSource::Stamp).unwrap();
        let truncation = motion.truncation.unwrap();
        assert!(truncation.is_cut && truncation.messages == 100, "{truncation}");
    }
}

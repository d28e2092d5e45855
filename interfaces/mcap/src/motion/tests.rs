//! The rules by which poses in files become motions.

use super::*;
use crate::messages::ChannelInfo;
use crate::{McapWriter, TopicMessage};
use ballast::component::Interpolation;
use ballast_protocol::messages::{
    Clock, Header, Point, Pose, Quaternion, Time, Transform, TransformStamped, Twist, Vector3,
};
use std::path::PathBuf;
use std::sync::Arc;

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, entries: &[TopicMessage]) -> PathBuf {
        let path = self.0.path().join("a.mcap");
        let mut writer = McapWriter::create(&path, None).unwrap();
        entries.iter().for_each(|entry| writer.write(entry).unwrap());
        writer.finish().unwrap();
        path
    }
}

fn bodies() -> Vec<String> {
    vec!["tine-1".into(), "sleeper".into()]
}

fn at(x: f64) -> Pose {
    Pose { position: Point { x, y: 0.0, z: 0.5 }, orientation: Quaternion::default() }
}

/// Recorded `delay` ns after its stamp.
fn pose(topic: &str, time_ns: u64, x: f64, delay: u64) -> TopicMessage {
    let message = PoseStamped { header: Header::world(time_ns), pose: at(x) };
    TopicMessage::of(topic, time_ns + delay, &message).unwrap()
}

fn twist(topic: &str, time_ns: u64, speed: f64) -> TopicMessage {
    let linear = Vector3 { x: speed, ..Vector3::default() };
    let twist = Twist { linear, ..Twist::default() };
    let message = TwistStamped { header: Header::world(time_ns), twist };
    TopicMessage::of(topic, time_ns, &message).unwrap()
}

fn transform(time_ns: u64, frame: &str, x: f64) -> TopicMessage {
    transform_in("world", "/tf", time_ns, frame, x)
}

fn transform_in(parent: &str, topic: &str, time_ns: u64, frame: &str, x: f64) -> TopicMessage {
    let translation = Vector3 { x, y: 0.0, z: 0.5 };
    let transform = TransformStamped {
        header: Header { frame_id: parent.into(), ..Header::world(time_ns) },
        child_frame_id: frame.into(),
        transform: Transform { translation, rotation: Quaternion::default() },
    };
    TopicMessage::of(topic, time_ns, &TFMessage { transforms: vec![transform] }).unwrap()
}

fn pose_in(frame: &str, topic: &str, time_ns: u64, x: f64) -> TopicMessage {
    let header = Header { frame_id: frame.into(), ..Header::world(time_ns) };
    TopicMessage::of(topic, time_ns, &PoseStamped { header, pose: at(x) }).unwrap()
}

fn read_all(path: &Path, maps: &[&str]) -> Result<RecordedMotion> {
    let maps: Vec<TopicMap> = maps.iter().map(|m| m.parse().unwrap()).collect();
    read(path, &bodies(), &maps, TimeSource::Stamp, 0)
}

fn times(input: &MotionInput) -> Vec<u64> {
    input.waveform.knots.iter().map(|k| k.time_ns).collect()
}

#[test]
fn a_knot_per_message_linear_without_twists() {
    let place = Place::new();
    let topic = "/tine_1/pose";
    let path =
        place.file(&[pose(topic, 0, 0.0, 5), pose(topic, 10, 1.0, 0), pose(topic, 30, 2.0, 5)]);
    let motion = read_all(&path, &[]).unwrap();
    assert_eq!((motion.start_ns, motion.end_ns, &motion.truncation), (0, 30, &None));
    let [input] = &motion.inputs[..] else { panic!("{motion:?}") };
    assert_eq!((&input.body[..], times(input)), ("tine-1", vec![0, 10, 30]));
    assert_eq!(input.waveform.interpolation, Interpolation::Linear);
    assert_eq!(input.waveform.pose(20).position.x, 1.5);
    let log = read(&path, &bodies(), &[], TimeSource::Log, 0).unwrap();
    assert_eq!(times(&log.inputs[0]), [0, 5, 30], "from 5, 10 and 35 ns");
}

#[test]
fn twists_of_the_same_times_make_it_cubic() {
    let place = Place::new();
    let poses = [pose("/m/pose", 0, 0.0, 0), pose("/m/pose", 1_000_000, 1e-6, 0)];
    let twists = [twist("/m/twist", 0, 1e-3), twist("/m/twist", 1_000_000, 1e-3)];
    let all = [poses.clone(), twists.clone()].concat();
    let motion = read_all(&place.file(&all), &["/m/pose=sleeper"]).unwrap();
    let waveform = &motion.inputs[0].waveform;
    assert_eq!(waveform.interpolation, Interpolation::Hermite);
    assert_eq!(waveform.knots[1].velocity.x, 1e-3);
    // A twist is missing: linear for the whole body, and it is said.
    let motion = read_all(&place.file(&all[..3]), &["/m/pose=sleeper"]).unwrap();
    assert_eq!(motion.inputs[0].waveform.interpolation, Interpolation::Linear);
    assert_eq!(motion.inputs[0].waveform.knots[0].velocity.x, 0.0);
    assert!(motion.notes[0].contains("some poses have no twist"), "{:?}", motion.notes);
    // A topic of twists by another name needs a map.
    let twists = twists.map(|e| TopicMessage { topic: "/speed".into(), ..e });
    let path = place.file(&[poses, twists].concat());
    let motion = read_all(&path, &["/m/pose=sleeper", "/speed=sleeper"]).unwrap();
    assert_eq!(motion.inputs[0].waveform.interpolation, Interpolation::Hermite);
}

#[test]
fn nothing_is_extrapolated_and_the_common_stretch_begins_the_run() {
    let place = Place::new();
    let (a, b) = ("/tine_1/pose", "/sleeper/pose");
    let early = [100, 200, 300].map(|t| pose(a, t, t as f64, 0));
    let late = [150, 250, 350].map(|t| pose(b, t, t as f64, 0));
    let path = place.file(&[early, late].concat());
    let motion = read(&path, &bodies(), &[], TimeSource::Stamp, 1000).unwrap();
    assert_eq!((motion.start_ns, motion.end_ns), (1000, 1150), "150 to 300 ns of the file");
    let by_name = |name: &str| motion.inputs.iter().find(|i| i.body == name).unwrap();
    assert_eq!(times(by_name("tine-1")), [1000, 1050, 1150]);
    assert_eq!(by_name("tine-1").waveform.knots[0].pose.position.x, 150.0);
    assert_eq!(times(by_name("sleeper")), [1000, 1100, 1200]);

    let apart = [pose(a, 0, 0.0, 0), pose(a, 10, 0.0, 0), pose(b, 20, 0.0, 0), pose(b, 30, 0.0, 0)];
    let error = read_all(&place.file(&apart), &[]).unwrap_err().to_string();
    assert!(error.contains("20 ns") && error.contains("10 ns"), "{error}");
}

#[test]
fn what_a_motion_leaves_out_or_bridges_is_told() {
    let place = Place::new();
    let (a, b) = ("/tine_1/pose", "/sleeper/pose");
    let body = |topic: &str, times: &[u64]| -> Vec<TopicMessage> {
        times.iter().map(|t| pose(topic, *t, 0.0, 0)).collect()
    };
    let notes = |entries: [Vec<TopicMessage>; 2]| {
        let notes = read_all(&place.file(&entries.concat()), &[]).unwrap().notes;
        notes[2..].to_vec()
    };
    let whole: Vec<u64> = (0..=50).map(|k| k * 1_000_000).collect();
    assert_eq!(notes([body(a, &whole), body(b, &whole[1..50])]), [""; 0]);
    let notes_found = notes([body(a, &whole), body(b, &whole[5..11])]);
    let says = |edge: &str| format!("{edge}, there is no pose of sleeper");
    assert!(
        notes_found[0].contains("at 0.005 s of the file, not at 0 s")
            && notes_found[0].ends_with(&says("before"))
    );
    assert!(
        notes_found[1].contains("at 0.01 s of the file, not at 0.05 s")
            && notes_found[1].ends_with(&says("after"))
    );
    let torn = [&whole[..20], &whole[40..]].concat();
    let notes_found = notes([body(a, &torn), body(b, &whole)]);
    assert!(
        notes_found.len() == 1 && notes_found[0].contains("tine-1: no pose from 0.019 to 0.04 s"),
        "{notes_found:?}"
    );
    // Outside of what is replayed nothing is missing.
    assert_eq!(notes([body(a, &torn), body(b, &whole[..15])]).len(), 1);
}

#[test]
fn twists_that_do_not_lead_from_pose_to_pose_are_warned_of() {
    let place = Place::new();
    // A vibration of 35 Hz, sampled at 100 Hz.
    let (turn, amplitude) = (std::f64::consts::TAU * 35.0, 3e-3);
    let warned = |scale: f64, amplitude: f64| {
        let entries: Vec<TopicMessage> = (0..60)
            .flat_map(|k| {
                let (time, angle) = (k * 10_000_000, turn * 0.01 * k as f64);
                let speed = scale * amplitude * turn * angle.cos();
                let topic = |what: &str| format!("/tine_1/{what}");
                let x = amplitude * angle.sin();
                [pose(&topic("pose"), time, x, 0), twist(&topic("twist"), time, speed)]
            })
            .collect();
        read_all(&place.file(&entries), &[]).unwrap().warnings
    };
    assert_eq!(warned(1.0, amplitude), [""; 0]);
    for scale in [0.0, 1e-3, 1e3, -1.0] {
        let warnings = warned(scale, amplitude);
        assert!(warnings[0].contains("twists of tine-1:") && warnings.len() == 1, "{scale}");
    }
    assert_eq!(warned(0.0, 0.2e-3), [""; 0], "what hardly moves says nothing");
}

#[test]
fn transforms_move_the_bodies_of_their_frames() {
    let place = Place::new();
    let tf = [transform(0, "tine-1", 0.0), transform(0, "arm", 5.0), transform(9, "tine-1", 1.0)];
    let motion = read_all(&place.file(&tf), &[]).unwrap();
    assert_eq!(motion.inputs[0].waveform.knots[1].pose.position.x, 1.0);
    let motion = read_all(&place.file(&tf), &["/tf:arm=sleeper"]).unwrap();
    assert_eq!((motion.inputs.len(), &motion.inputs[0].body[..]), (1, "sleeper"));
    // The topic of a body takes precedence over transforms.
    let both = [tf[0].clone(), pose("/tine_1/pose", 0, 7.0, 0)];
    let motion = read_all(&place.file(&both), &[]).unwrap();
    assert_eq!(motion.inputs[0].waveform.knots[0].pose.position.x, 7.0);
}

#[test]
fn poses_in_a_frame_that_the_file_places_are_refused() {
    let place = Place::new();
    let arm = |time, x| transform_in("/unit", "/tf", time, "tine-1", x);
    for topic in ["/tf", "/tf_static", "/machine/tf"] {
        let unit = [0, 9].map(|t| transform_in("world", topic, t, "unit", 1e-3 * t as f64));
        let tree = [unit.to_vec(), vec![arm(0, 1.0), arm(9, 1.0)]].concat();
        let error = read_all(&place.file(&tree), &[]).unwrap_err().to_string();
        assert!(error.contains("poses of \"tine-1\": expected"), "{error}");
        assert!(error.contains(&format!("\"/unit\", which {topic} places")), "{error}");
        // The topic of a body takes precedence over transforms.
        let own = [tree.clone(), vec![pose("/tine_1/pose", 0, 0.0, 0)]].concat();
        read_all(&place.file(&own), &[]).unwrap();
        let poses = [unit.to_vec(), vec![pose_in("unit", "/tine_1/pose", 0, 0.0)]].concat();
        let error = read_all(&place.file(&poses), &[]).unwrap_err().to_string();
        assert!(error.contains("\"unit\""), "{error}");
    }
    // What is called as the bed's frame may have a place on the earth.
    let tf = ["map", "world"].map(|frame| transform_in("earth", "/tf_static", 0, frame, 7.0));
    let on_earth = [&tf[..], &[pose_in("map", "/tine_1/pose", 0, 0.0)]].concat();
    assert_eq!(read_all(&place.file(&on_earth), &[]).unwrap().notes.len(), 1);
}

#[test]
fn frames_other_than_the_bed_s_are_named() {
    let place = Place::new();
    let (a, b) = ("/tine_1/pose", "/sleeper/pose");
    let path = place.file(&[pose_in("unit", a, 0, 0.0), pose_in("unit", b, 0, 0.0)]);
    let notes = read_all(&path, &[]).unwrap().notes;
    assert!(notes[0].starts_with("poses in the frame \"unit\" are taken"), "{notes:?}");
    assert!(notes[0].ends_with("sleeper, tine-1") && notes.len() == 3, "{notes:?}");
    for silent in ["", "/world", "map"] {
        let notes = read_all(&place.file(&[pose_in(silent, a, 0, 0.0)]), &[]).unwrap().notes;
        assert_eq!(notes.len(), 1, "{notes:?}");
    }
    let path = place.file(&[transform_in("rail", "/tf", 0, "tine-1", 0.0)]);
    let notes = read_all(&path, &[]).unwrap().notes;
    assert!(notes[0].contains("\"rail\""), "{notes:?}");
}

#[test]
fn two_sources_for_one_body_are_refused() {
    let place = Place::new();
    let path = place.file(&[
        pose("/a", 0, 0.0, 0),
        transform(0, "b", 0.0),
        pose("/c/pose", 0, 0.0, 0),
        twist("/c/twist", 0, 0.1),
        twist("/d", 0, 0.2),
    ]);
    for (maps, found) in [
        (["/a=sleeper", "/c/pose=sleeper"], "/a and /c/pose"),
        (["/a=sleeper", "/tf:b=sleeper"], "/a and /tf:b"),
        (["/c/pose=sleeper", "/d=sleeper"], "/c/twist and /d"),
    ] {
        let error = read_all(&path, &maps).unwrap_err().to_string();
        assert!(error.contains(found) && error.contains("sleeper"), "{error}");
    }
    // A topic of twists beside one of poses is no second motion.
    read_all(&path, &["/a=sleeper", "/d=sleeper"]).unwrap();
}

#[test]
fn messages_out_of_order_are_sorted_and_two_poses_at_a_time_refused() {
    let place = Place::new();
    let topic = "/tine_1/pose";
    let path =
        place.file(&[pose(topic, 20, 2.0, 0), pose(topic, 0, 0.0, 0), pose(topic, 20, 2.0, 9)]);
    assert_eq!(times(&read_all(&path, &[]).unwrap().inputs[0]), [0, 20]);
    let unstamped = [pose(topic, 0, 0.0, 0), pose(topic, 0, 1.0, 9)];
    let error = read_all(&place.file(&unstamped), &[]).unwrap_err().to_string();
    assert!(error.contains("0 ns") && error.contains("--time log"), "{error}");
    // A second and more beside the seconds.
    let mut message = PoseStamped { header: Header::world(7), pose: at(0.0) };
    message.header.stamp.nanosec = 1_000_000_000;
    let odd = TopicMessage::of(topic, 7, &message).unwrap();
    let error = read_all(&place.file(&[pose(topic, 0, 0.0, 0), odd]), &[]).unwrap_err().to_string();
    assert!(error.contains("header.stamp.nanosec") && error.contains("1000000000"), "{error}");
}

#[test]
fn what_a_motion_keeps_is_limited_and_what_says_nothing_is_not_kept() {
    let assignment = Assignment::new(Path::new("a.mcap"), &bodies(), &[]).unwrap();
    let channel = |topic: &str, kind: &str| {
        let (topic, schema) = (topic.into(), format!("geometry_msgs/msg/{kind}"));
        Arc::new(ChannelInfo { topic, encoding: "cdr".into(), schema })
    };
    let message = |topic: &str, kind: &str, entry: TopicMessage| {
        let channel = channel(topic, kind);
        McapMessage { channel, log_time: entry.time_ns, data: entry.bytes }
    };
    let a_pose = |time| message("/tine_1/pose", "PoseStamped", pose("", time, 0.0, 0));
    let a_twist = |time| message("/tine_1/twist", "TwistStamped", twist("", time, 0.0));
    let take =
        |found: &mut PoseCollector, message| found.take(&assignment, &message, TimeSource::Stamp);
    let mut found = PoseCollector::default();
    for message in [a_pose(0), a_twist(0)] {
        take(&mut found, message).unwrap();
    }
    let kept = found.bytes;
    for _ in 0..1000 {
        take(&mut found, a_pose(0)).unwrap();
        take(&mut found, a_twist(0)).unwrap();
    }
    assert_eq!(found.bytes, kept, "the same again");
    for other in [a_pose(1), a_twist(1)] {
        let mut found = PoseCollector { bytes: MAX_CHUNK_BYTES - kept, ..PoseCollector::default() };
        take(&mut found, a_pose(0)).unwrap();
        take(&mut found, a_twist(0)).unwrap();
        let refused = take(&mut found, other).unwrap_err().to_string();
        let expected = "motion: expected at most 268435456 bytes of poses, twists and names";
        assert!(refused.starts_with(expected), "{refused}");
    }
    // Names of topics and frames are kept, too.
    let named = McapMessage { channel: channel(&"/a".repeat(500), "Pose"), ..a_pose(0) };
    let mut found = PoseCollector { bytes: MAX_CHUNK_BYTES - 1000, ..PoseCollector::default() };
    assert!(take(&mut found, named).is_err());
    let framed = |k: u64| {
        let entry = transform(0, &format!("{k}{}", "f".repeat(100)), 0.0);
        let channel = ChannelInfo {
            schema: "tf2_msgs/msg/TFMessage".into(),
            ..(*channel("/tf", "")).clone()
        };
        McapMessage { channel: channel.into(), log_time: 0, data: entry.bytes }
    };
    let mut found = PoseCollector { bytes: MAX_CHUNK_BYTES - 1000, ..PoseCollector::default() };
    assert!((0..10).any(|k| take(&mut found, framed(k)).is_err()));
}

#[test]
fn what_cannot_be_used_is_named() {
    let place = Place::new();
    let clock = TopicMessage::of("/clock", 0, &Clock { clock: Time::from_ns(0) }).unwrap();
    let entries = [clock, pose("/tine_1/pose", 0, 0.0, 0), transform(0, "arm", 0.0)];
    let path = place.file(&entries);
    for (map, said) in [
        ("/clock=sleeper", "rosgraph_msgs/msg/Clock"),
        ("/arm/pose=sleeper", "/tine_1/pose"),
        ("/tine_1/pose=crane", "crane"),
        ("/tf:leg=sleeper", "/tf:arm"),
    ] {
        let error = read_all(&path, &[map]).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains("a.mcap"), "{error}");
    }
    // A pose is of one body.
    let twice = ["/tine_1/pose=tine-1", "/tine_1/pose=sleeper"];
    let error = read_all(&path, &twice).unwrap_err().to_string();
    assert!(error.contains("tine-1") && error.contains("sleeper"), "{error}");
    let error = read_all(&place.file(&entries[..1]), &[]).unwrap_err().to_string();
    assert!(error.contains("/clock") && error.contains("--map"), "{error}");
    // Frames of other names than the bodies', on the usual topic and on another.
    let tf = transform_in("world", "/machine/tf", 0, "tine-1", 0.0);
    let path = place.file(&[transform(0, "/tine-1", 0.0), tf]);
    let error = read_all(&path, &[]).unwrap_err().to_string();
    let frames = "frames [\"/machine/tf:tine-1\", \"/tf:/tine-1\"]";
    assert!(error.contains(frames) && error.contains("TOPIC:FRAME=BODY"), "{error}");
    for text in ["", "=a", "/a=", "/a"] {
        assert!(text.parse::<TopicMap>().is_err(), "{text}");
    }
    let mut turned = PoseStamped { header: Header::world(0), pose: at(0.0) };
    turned.pose.orientation.w = 0.9;
    let turned = TopicMessage::of("/tine_1/pose", 0, &turned).unwrap();
    let error = read_all(&place.file(&[turned]), &[]).unwrap_err().to_string();
    assert!(error.contains("unit quaternion"), "{error}");
}

#[test]
fn json_poses_are_read_in_their_forms() {
    let pose = r#"{"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}"#;
    let read = |text: &str| json_pose::read(text.as_bytes());
    let plain = read(pose).unwrap();
    assert_eq!((plain.pose.position.z, plain.stamp_ns, &plain.frame[..]), (3.0, None, ""));
    let stamped =
        format!(r#"{{"header": {{"stamp": {{"sec": 1, "nanosec": 5}}}}, "pose": {pose}}}"#);
    assert_eq!(read(&stamped).unwrap().stamp_ns, Some(1_000_000_005));
    let framed = stamped.replace("{\"stamp\"", "{\"frame_id\": \"unit\", \"stamp\"");
    assert_eq!(read(&framed).unwrap().frame, "unit");
    let timed = format!(
        r#"{{"time_ns": 7, "pose": {pose}, "twist": {{"linear": {{"x": 1, "y": 0, "z": 0}},
        "angular": {{"x": 0, "y": 0, "z": 2}}}}}}"#
    );
    let timed = read(&timed).unwrap();
    assert_eq!((timed.stamp_ns, timed.twist.unwrap().angular.z), (Some(7), 2.0));
    let odometry = format!(r#"{{"pose": {{"pose": {pose}}}, "twist": {{"twist": {{}}}}}}"#);
    assert_eq!(read(&odometry).unwrap(), plain);
    for (wrong, place) in [
        (pose.replace("\"y\": 2", "\"y\": null"), "position.y"),
        (pose.replace("\"w\"", "\"v\""), "orientation.w"),
        (format!(r#"{{"timestamp": {{"sec": 1}}, "pose": {pose}}}"#), "stamp"),
        (stamped.replace("\"nanosec\": 5", "\"nanosec\": 1000000000"), "stamp"),
        (stamped.replace("\"nanosec\": 5", "\"nanosec\": -1"), "stamp"),
        ("{".into(), "message"),
    ] {
        assert_eq!(read(&wrong).unwrap_err().place, place);
    }
}

//! Recordings: made, replayed to the same state, verified, damaged.

use crate::setup::{CASE, Ended, Place};
use ballast_mcap::messages::MessageReader;
use ballast_mcap::{McapWriter, TopicMessage};
use ballast_protocol::messages::{
    AdvanceReply, Header, PoseStamped, SceneUpdate, SqueezeReport, WindowRecord,
};
use ballast_protocol::{from_cdr, to_cdr};
use std::io::{BufRead, BufReader};
use std::process::Stdio;

/// Steps that these tests record: into the insertion, where tines have met grains.
const STEPS: u64 = 60;

/// A place with a recording `run.mcap` of a run in `run`.
fn recorded() -> Place {
    let place = Place::new();
    place.run(&format!("--out run --record run.mcap --steps {STEPS} --threads 1")).with_code(0);
    place
}

fn replay(place: &Place, arguments: &str) -> Ended {
    place.with_beds(&format!("replay --case tiny.toml {arguments}"))
}

fn verify(place: &Place, file: &str) -> Ended {
    place.with_beds(&format!("verify {file}"))
}

/// Topics and times of a recording, and the records of its windows.
fn contents(place: &Place, file: &str) -> (Vec<(String, u64)>, Vec<WindowRecord>) {
    let mut messages = MessageReader::open(&place.path(file)).unwrap();
    let (mut all, mut records) = (Vec::new(), Vec::new());
    while let Some(message) = messages.next().unwrap() {
        if message.channel.topic == "/ballast/step" {
            records.push(from_cdr(&message.data).unwrap());
        }
        all.push((message.channel.topic.clone(), message.log_time));
    }
    assert_eq!(messages.truncation(), None);
    (all, records)
}

#[test]
fn a_replay_ends_in_the_state_of_the_run_and_leaves_the_same_recording() {
    let place = recorded();
    let hash = place.hash("run");
    // It needs no case: the one that was run is in it.
    std::fs::remove_file(place.path("tiny.toml")).unwrap();
    let again = format!("replay run.mcap --out again --record again.mcap --expect-hash {hash}");
    let said = place.with_beds(&again).with_code(0).stdout();
    assert!(said.contains("  again.mcap\n"), "the recording is among the files: {said}");
    std::fs::write(place.path("tiny.toml"), CASE).unwrap();
    assert_eq!(place.hash("again"), hash);
    assert_eq!(place.summary("again")["tines"], place.summary("run")["tines"]);
    let bytes = |name: &str| std::fs::read(place.path(name)).unwrap();
    assert!(bytes("run.mcap") == bytes("again.mcap"), "equal runs leave equal bytes");
    assert!(!place.path("again/checkpoint.h5").exists());

    // Recording changes nothing.
    place.run(&format!("--out silent --steps {STEPS}")).with_code(0);
    assert_eq!(place.hash("silent"), hash);

    let (all, records) = contents(&place, "run.mcap");
    assert_eq!(records.len() as u64, STEPS);
    assert_eq!(records.last().unwrap().hash.to_string(), hash);
    for topic in [
        "/clock",
        "/tf",
        "/tf_static",
        "/log",
        "/stones",
        "/scene",
        "/ballast/energy",
        "/ballast/solver",
    ] {
        assert!(all.iter().any(|(t, _)| t == topic), "{topic}");
    }
    assert!(all.iter().any(|(t, _)| t.starts_with("/ballast/zone/under_")));
    assert!(all.is_sorted_by_key(|(_, time)| *time));
}

#[test]
fn squeezes_are_recorded_and_verified() {
    let place = Place::new();
    // On the case's own bed the tines jam.
    place.run("--out run --record run.mcap --seed 11").with_code(0);
    let mut messages = MessageReader::open(&place.path("run.mcap")).unwrap();
    let mut squeezes: Vec<SqueezeReport> = vec![];
    while let Some(message) = messages.next().unwrap() {
        if message.channel.topic == "/ballast/squeeze/pair_0" {
            squeezes.push(from_cdr(&message.data).unwrap());
        }
    }
    // Forces are arrows in the pictures of the squeeze.
    let mut messages = MessageReader::open(&place.path("run.mcap")).unwrap();
    let mut arrows = 0;
    while let Some(message) = messages.next().unwrap() {
        if message.channel.topic == "/scene" {
            let scene: SceneUpdate = from_cdr(&message.data).unwrap();
            arrows += scene.entities.iter().map(|e| e.arrows.len()).sum::<usize>();
        }
    }
    assert!(arrows > 0);
    // The case closes by 20 mm a side and opens again while the tines are withdrawn.
    let last = squeezes.last().expect("the machine squeezes");
    assert!(squeezes.iter().all(|s| (s.pair.as_str(), s.number) == ("pair_0", 1)), "{last:?}");
    let closed = squeezes.iter().map(|s| s.closing).fold(0.0, f64::max);
    assert!((0.01..0.021).contains(&closed), "{closed}");
    assert!(last.peak_force > 0.0 && last.peak_step_force >= last.peak_force, "{last:?}");
    assert!(last.loop_closing.len() > 2 && last.loop_closing.len() == last.loop_force.len());
    verify(&place, "run.mcap").with_code(0);
}

#[test]
fn a_recording_is_verified_as_a_whole_and_in_part() {
    let place = recorded();
    let ended = verify(&place, "run.mcap").with_code(0);
    assert!(ended.stdout().contains(&format!("{STEPS} windows")), "{}", ended.stdout());

    let whole = std::fs::read(place.path("run.mcap")).unwrap();
    std::fs::write(place.path("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let ended = verify(&place, "cut.mcap").with_code(0);
    assert!(ended.stderr().contains("the file ends"), "{}", ended.stderr());
    assert!(!ended.stdout().contains(&format!("{STEPS} windows")), "{}", ended.stdout());
    // Nothing to compare is not the same as nothing that differs, and damage is no end.
    let chunk = whole.windows(4).position(|w| w == b"zstd").unwrap();
    std::fs::write(place.path("start.mcap"), &whole[..chunk]).unwrap();
    let said = verify(&place, "start.mcap").with_code(1).stderr();
    assert!(said.contains("found none"), "{said}");
    let mut damaged = whole.clone();
    // In a chunk: an index beside it that lies does no harm.
    let half = &whole[..whole.len() / 2];
    damaged[half.windows(4).rposition(|w| w == b"zstd").unwrap() + 100] ^= 1;
    std::fs::write(place.path("damaged.mcap"), damaged).unwrap();
    let said = verify(&place, "damaged.mcap").with_code(1).stderr();
    assert!(said.contains("windows are equal, the rest is damaged"), "{said}");
    // It is replayed up to the damage, and not reported as complete.
    let said = replay(&place, "damaged.mcap --out damaged").with_code(1).stderr();
    assert!(said.contains("damaged.mcap: it is damaged"), "{said}");
    assert!(place.summary("damaged")["steps"].as_u64().unwrap() < STEPS);
    assert_eq!(place.summary("damaged")["complete"], false);
    // A chunk that is none any more by a single bit, and one that claims to be longer than the file.
    let middle = half.windows(4).rposition(|w| w == b"zstd").unwrap() - 32 - 9;
    for (at, bit) in [(middle, 0x80), (middle, 0x08), (middle, 0x01), (middle + 5, 1)] {
        let mut damaged = whole.clone();
        assert_eq!(damaged[middle], mcap::records::op::CHUNK);
        damaged[at] ^= bit;
        std::fs::write(place.path("damaged.mcap"), damaged).unwrap();
        let said = verify(&place, "damaged.mcap").with_code(1).stderr();
        assert!(said.contains("windows are equal, the rest is damaged"), "{said}");
    }
    let ended = replay(&place, "cut.mcap --out cut").with_code(0);
    assert!(ended.stderr().contains("the file ends"), "{}", ended.stderr());
    let steps = place.summary("cut")["steps"].as_u64().unwrap();
    assert!((1..STEPS).contains(&steps), "{steps}");
    assert_eq!(place.summary("cut")["complete"], false, "more was recorded than there is");
}

#[test]
fn a_part_of_a_run_is_the_whole_of_its_replay() {
    let place = Place::new();
    let last_share = |ended: Ended| {
        let events = ended.with_code(0).events();
        let mut progress = events.iter().rev().filter(|event| event["event"] == "progress");
        progress.next().expect("progress")["fraction"].as_f64()
    };
    let run = place.run("--out run --steps 40 --record run.mcap --json");
    assert_eq!(last_share(run), Some(1.0));
    assert_eq!(last_share(place.with_beds("verify run.mcap --json")), Some(1.0));
    let ended = replay(&place, "run.mcap --out again").with_code(0);
    assert!(ended.stdout().contains(" 40 of 40 steps"), "{}", ended.stdout());
    assert!(ended.stderr().contains("tiny  50 %"), "{}", ended.stderr());
    assert_eq!(place.summary("again")["complete"], true);
    place.call("resume run/checkpoint.h5 --steps 60").with_code(0);
    assert_eq!(place.summary("run")["complete"], false);
}

/// A copy of the recording with every message passed through `change`, which may leave none of its topic, or
/// several.
fn rewrite(place: &Place, change: impl Fn(&str, u64, Vec<u8>) -> Vec<Vec<u8>>) {
    use mcap::records::MessageHeader;
    let source = std::fs::read(place.path("run.mcap")).unwrap();
    let file = std::fs::File::create(place.path("other.mcap")).unwrap();
    let mut writer = mcap::Writer::new(file).unwrap();
    let summary = mcap::Summary::read(&source).unwrap().unwrap();
    let index = &summary.metadata_indexes[0];
    writer.write_metadata(&mcap::read::metadata(&source, index).unwrap()).unwrap();
    for message in mcap::MessageStream::new(&source).unwrap() {
        let message = message.unwrap();
        let channel = &message.channel;
        let schema = channel.schema.as_ref().unwrap();
        let schema = writer.add_schema(&schema.name, &schema.encoding, &schema.data).unwrap();
        let id = writer
            .add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)
            .unwrap();
        let (log_time, publish_time) = (message.log_time, message.publish_time);
        let header = MessageHeader { channel_id: id, sequence: 0, log_time, publish_time };
        for data in change(&channel.topic, log_time, message.data.to_vec()) {
            writer.write_to_known_channel(&header, &data).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn the_first_difference_is_named() {
    let place = recorded();
    rewrite(&place, |_, _, data| vec![data]);
    verify(&place, "other.mcap").with_code(0);

    // Where the tines were at the start.
    rewrite(&place, |t, time, data| {
        if time > 0 || !t.ends_with("/pose") {
            return vec![data];
        }
        let mut message: PoseStamped = from_cdr(&data).unwrap();
        message.pose.position.z += 1e-9;
        vec![to_cdr(&message).unwrap()]
    });
    let said = verify(&place, "other.mcap").with_code(5).stderr();
    assert!(said.contains("window 0, step 0 at 0 ns") && said.contains("position.z"), "{said}");

    // A message too many, and one too few.
    for (count, recorded) in
        [(2, "recorded one, computed none"), (0, "recorded none, computed one")]
    {
        rewrite(&place, |t, time, data| {
            vec![data; if t == "/ballast/energy" && time == 30_000_000 { count } else { 1 }]
        });
        let said = verify(&place, "other.mcap").with_code(5).stderr();
        assert!(said.contains("window 30") && said.contains(recorded), "{said}");
    }

    // A force that was not, in step 40.
    let (all, _) = contents(&place, "run.mcap");
    let topic =
        &all.iter().find(|(t, _)| t.starts_with("/tine") && t.ends_with("/impulse")).unwrap().0;
    rewrite(&place, |t, time, data| {
        if t != topic || time != 40_000_000 {
            return vec![data];
        }
        let mut message: ballast_protocol::messages::WrenchImpulse = from_cdr(&data).unwrap();
        message.impulse.z += 1e-12;
        vec![to_cdr(&message).unwrap()]
    });
    let said = verify(&place, "other.mcap").with_code(5).stderr();
    for part in ["window 40", "step 40", topic, "impulse.z"] {
        assert!(said.contains(part), "{part}: {said}");
    }

    // A motion that was not: the tine is elsewhere at the end of that very step.
    rewrite(&place, |t, time, data| {
        if t != "/ballast/step" || time != 50_000_000 {
            return vec![data];
        }
        let mut record: WindowRecord = from_cdr(&data).unwrap();
        let input = record.request.motions.iter_mut().find(|m| m.body.starts_with("tine")).unwrap();
        input.knots[1].pose.position.z += 1e-6;
        vec![to_cdr(&record).unwrap()]
    });
    let said = verify(&place, "other.mcap").with_code(5).stderr();
    assert!(said.contains("window 50") && !said.contains("of the case"), "{said}");
    assert!(said.contains("/pose") || said.contains("/tf"), "{said}");
}

#[test]
fn another_case_is_noticed() {
    let place = recorded();
    let other = CASE.replace("restitution", "#").replace("hold_s = 0.004", "hold_s = 0.004\n");
    std::fs::write(
        place.path("tiny.toml"),
        other.replace("max_iterations = 30", "max_iterations = 31"),
    )
    .unwrap();
    let said = place.with_beds("verify run.mcap --case tiny.toml").with_code(5).stderr();
    assert!(said.contains("initial_hash"), "{said}");
    let line = CASE.lines().position(|line| line.starts_with("hold_s")).unwrap() + 2;
    let line = format!("line {line} of the case: recorded \"[tamping.lift]\", here \"\"");
    assert!(said.contains(&line), "{said}");
    // A line that nothing depends on before the tines go down.
    std::fs::write(place.path("tiny.toml"), CASE.replace("depth_m = 0.004", "depth_m = 0.003"))
        .unwrap();
    let said = place.with_beds("verify run.mcap --case tiny.toml").with_code(5).stderr();
    assert!(said.contains("the case: recorded \"depth_m = 0.004\", here"), "{said}");
    assert!(!said.contains(", :") && !said.contains("come from another build"), "{said}");
    std::fs::write(
        place.path("tiny.toml"),
        other.replace("max_iterations = 30", "max_iterations = 31"),
    )
    .unwrap();
    let ended = replay(&place, "run.mcap --out other").with_code(0);
    assert!(ended.stderr().contains("results will differ"), "{}", ended.stderr());
    assert_ne!(place.hash("other"), place.hash("run"));
}

#[test]
fn a_start_that_differs_with_all_that_is_known_of_it_alike_is_told_to_be_of_the_bed() {
    let place = recorded();
    let mut bytes = std::fs::read(place.path("run.mcap")).unwrap();
    let key = b"initial_hash\x20\0\0\0";
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap() + key.len();
    bytes[at] = if bytes[at] == b'0' { b'1' } else { b'0' };
    std::fs::write(place.path("other.mcap"), bytes).unwrap();
    let said = verify(&place, "other.mcap").with_code(5).stderr();
    assert!(said.contains("come from another build"), "{said}");
    assert!(said.contains("`ballast prepare CASE --force` (and the same `--bed-cache`)"), "{said}");
}

#[test]
fn what_nobody_can_repeat_is_not_verified() {
    let place = Place::new();
    let run = "--out run --record run.mcap --steps 3 --schedule asynchronous --threads 1";
    let said = place.run(run).with_code(0).stderr();
    assert!(said.contains("`ballast verify` cannot repeat"), "{said}");
    let said = verify(&place, "run.mcap").with_code(1).stderr();
    assert!(
        said.contains("run.mcap: expected the sequential or the synchronous schedule"),
        "{said}"
    );
}

#[test]
fn the_choices_of_the_command_line_are_part_of_a_recording() {
    let place = Place::new();
    place.run("--out run --record run.mcap --steps 12 --schedule sequential").with_code(0);
    let hash = place.hash("run");
    replay(&place, &format!("run.mcap --out again --expect-hash {hash}")).with_code(0);
    verify(&place, "run.mcap").with_code(0);
}

/// Poses of a body that rises by equal distances for a number of steps, at 1 kHz.
fn rising(place: &Place, from: PoseStamped, steps: u64, by: f64) {
    let mut writer = McapWriter::create(&place.path("rising.mcap"), None).unwrap();
    for i in 0..=steps {
        let (time, mut pose) = (i * 1_000_000, from.clone());
        pose.header = Header::world(time);
        pose.pose.position.z += by * i as f64;
        writer.write(&TopicMessage::of("/machine/arm", time, &pose).unwrap()).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn poses_of_any_file_move_a_body() {
    let place = recorded();
    let mut messages = MessageReader::open(&place.path("run.mcap")).unwrap();
    let first = loop {
        let message = messages.next().unwrap().unwrap();
        let topic = &message.channel.topic;
        if topic.starts_with("/tine") && topic.ends_with("/pose") {
            break message;
        }
    };
    let body = first.channel.topic.split('/').nth(1).unwrap().to_string();
    let start: PoseStamped = from_cdr(&first.data).unwrap();
    rising(&place, start.clone(), 20, 1e-6);

    let map = format!("--map /machine/arm={body}");
    let ended =
        replay(&place, &format!("rising.mcap {map} --out up --record up.mcap")).with_code(0);
    assert!(ended.stderr().contains("linear"), "{}", ended.stderr());
    assert_eq!(place.summary("up")["steps"], 20);
    assert_eq!(place.summary("up")["coordination"]["minimum"]["phase"], "done");
    let (_, records) = contents(&place, "up.mcap");
    let input = records[19].request.motions.iter().find(|m| m.body == body).unwrap();
    assert!((input.knots[1].pose.position.z - start.pose.position.z - 20e-6).abs() < 1e-12);
    // What was replayed from poses is a recording like any other.
    verify(&place, "up.mcap").with_code(0);
    let hash = place.hash("up");
    replay(&place, &format!("up.mcap --out once-more --expect-hash {hash}")).with_code(0);

    // A body elsewhere is refused, unless it is let go there.
    let mut elsewhere = start.clone();
    elsewhere.pose.position.z += 1e-3;
    rising(&place, elsewhere, 20, 1e-6);
    let said = replay(&place, &format!("rising.mcap {map} --out up")).with_code(1).stderr();
    assert!(said.contains(&body) && said.contains("--allow-jump"), "{said}");
    assert!(!said.contains("are kept"), "nothing was begun: {said}");
    let unpoured = format!("replay rising.mcap {map} --case tiny.toml --bed-cache unpoured");
    let refused = place.call(&unpoured).with_code(1).stderr();
    assert!(refused.contains("--allow-jump") && !place.path("unpoured").exists(), "{refused}");
    assert_eq!(place.hash("up"), hash, "what was refused replaces nothing");
    replay(&place, &format!("rising.mcap {map} --out off --allow-jump")).with_code(0);

    let ended = replay(&place, "rising.mcap --out none").with_code(1);
    assert!(ended.stderr().contains("/machine/arm"), "{}", ended.stderr());
    let ended = replay(&place, "rising.mcap --out none --map /machine/arm=crane").with_code(1);
    assert!(ended.stderr().contains("crane"), "{}", ended.stderr());
    // Nothing stops a tine at the floor.
    rising(&place, start.clone(), 20, -0.01);
    let said = replay(&place, &format!("rising.mcap {map} --out deep --steps 1")).with_code(0);
    let said = said.stderr();
    assert!(
        said.contains("warning: rising.mcap: poses of") && said.contains("\"floor\""),
        "{said}"
    );
    // A pose is no motion.
    rising(&place, start, 0, 0.0);
    let said = replay(&place, &format!("rising.mcap {map} --out up")).with_code(1).stderr();
    assert!(said.contains("rising.mcap: expected motions"), "{said}");
    assert!(said.contains("a body needs two poses to move"), "{said}");
    assert_eq!(place.hash("up"), hash);
}

#[test]
fn poses_with_impossible_stamps_begin_no_run() {
    let place = Place::new();
    place.run("--out run --steps 2 --record run.mcap").with_code(0);
    let mut messages = MessageReader::open(&place.path("run.mcap")).unwrap();
    let mut writer = McapWriter::create(&place.path("stamps.mcap"), None).unwrap();
    let now = 1_700_000_000_000_000_000;
    while let Some(message) = messages.next().unwrap() {
        let topic = &message.channel.topic;
        if message.log_time > 0 || !topic.starts_with("/tine") || !topic.ends_with("/pose") {
            continue;
        }
        let mut pose: PoseStamped = from_cdr(&message.data).unwrap();
        for i in 0..=20 {
            // The first stamp is not set.
            let time = now + i * 1_000_000;
            pose.header = Header::world(if i == 0 { 0 } else { time });
            writer.write(&TopicMessage::of(&topic[..], time, &pose).unwrap()).unwrap();
        }
    }
    writer.finish().unwrap();
    let call = "replay stamps.mcap --case tiny.toml --bed-cache unpoured --out out";
    let said = place.call(call).with_code(1).stderr();
    assert!(
        said.contains("/pose at 1700000000001000000 ns, stamp: expected at most 600 s"),
        "{said}"
    );
    assert!(said.contains("--time log") && !place.path("unpoured").exists(), "{said}");
    replay(&place, "stamps.mcap --time log --out log").with_code(0);
    assert_eq!(place.summary("log")["steps"], 20);
    // A folder of rosbag2 has files that can be replayed.
    std::fs::create_dir(place.path("bag")).unwrap();
    std::fs::rename(place.path("stamps.mcap"), place.path("bag/bag_0.mcap")).unwrap();
    for command in ["replay", "verify"] {
        let call = format!("{command} bag --case tiny.toml");
        let said = place.with_beds(&call).with_code(1).stderr();
        assert!(
            said.contains("bag: recording: expected a file, found a folder; use bag_0.mcap"),
            "{said}"
        );
    }
}

#[test]
fn a_recording_that_does_not_fit_the_given_case_is_refused_before_a_bed_is_prepared() {
    let place = Place::new();
    place.run("--out run --steps 5 --record run.mcap").with_code(0);
    let [tines, run] = ["[tines]", "[run]"].map(|table| CASE.find(table).unwrap());
    let untamped = CASE[..tines].replace("tamped = [1]", "") + &CASE[run..];
    std::fs::write(place.path("untamped.toml"), untamped).unwrap();
    let steps =
        ["step_s = 1e-3\noutput_interval_s = 0.01", "step_s = 1.5e-3\noutput_interval_s = 0.015"];
    std::fs::write(place.path("step.toml"), CASE.replace(steps[0], steps[1])).unwrap();
    for case in ["untamped.toml", "step.toml"] {
        let call = format!("replay run.mcap --case {case} --out other --bed-cache unpoured");
        let refused = place.call(&call).with_code(1).stderr();
        assert!(refused.contains("run.mcap") && !place.path("unpoured").exists(), "{refused}");
    }
}

#[test]
fn a_killed_run_leaves_a_recording_that_is_true_as_far_as_it_goes() {
    // Slow enough that the run is still going when it is killed.
    let place =
        Place::with(&CASE.replace(
            "max_iterations = 30\ntolerance = 1e-3",
            "max_iterations = 1000\ntolerance = 0",
        ));
    let mut child = place
        .run_command("--out killed --record killed.mcap --json --threads 1")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let far = lines.any(|line| {
        let event: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        event["event"] == "progress" && event["fraction"].as_f64().unwrap() > 0.2
    });
    assert!(far, "the run ended before it could be killed");
    child.kill().unwrap();
    child.wait().unwrap();
    let ended = verify(&place, "killed.mcap").with_code(0);
    assert!(ended.stderr().contains("the file ends"), "{}", ended.stderr());
    assert!(ended.stdout().contains("all equal"), "{}", ended.stdout());
    assert!(!ended.stdout().contains(" 0 windows"), "{}", ended.stdout());
}

#[test]
fn the_recorded_machine_moves_the_first_example() {
    let place = Place::new();
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples");
    let file = format!("{examples}/recorded_tamping.mcap");
    let command = format!(
        "replay {file} --case {examples}/first.toml --out here --steps 12 --record here.mcap"
    );
    let ended = place.with_beds(&command).with_code(0);
    assert_eq!(ended.stderr().matches("601 poses, cubic").count(), 3, "{}", ended.stderr());
    assert_eq!(place.summary("here")["steps"], 12);
    // Steps of 0.8 ms meet a knot every 4 ms, where the file has a velocity.
    place.call("verify here.mcap").with_code(0);
    let hash = place.hash("here");
    place.with_beds(&format!("replay here.mcap --out again --expect-hash {hash}")).with_code(0);
}

#[test]
fn bad_files_end_with_their_codes() {
    let place = Place::new();
    std::fs::write(place.path("bad.mcap"), "not a recording").unwrap();
    for command in ["replay", "verify"] {
        let said =
            place.with_beds(&format!("{command} bad.mcap --case tiny.toml")).with_code(1).stderr();
        assert!(said.contains("bad.mcap") && said.contains("expected"), "{said}");
        let said =
            place.with_beds(&format!("{command} none.mcap --case tiny.toml")).with_code(1).stderr();
        assert!(said.contains("none.mcap"), "{said}");
    }
    // Poses have no case.
    let poses = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/recorded_tamping.mcap");
    let said = place.with_beds(&format!("replay {poses}")).with_code(2).stderr();
    assert!(said.contains("--case"), "{said}");
    place.call("replay bad.mcap --case tiny.toml --map x").with_code(2);
    place.run("--out run --record run.mcap --steps 3").with_code(0);
    for for_poses in ["--allow-jump", "--time log"] {
        let said = replay(&place, &format!("run.mcap {for_poses}")).with_code(2).stderr();
        assert!(said.contains("contains the windows of a run"), "{said}");
    }
    let said = place.call("export run.mcap --out csv").with_code(1).stderr();
    assert!(said.contains("run.mcap: expected results, found a recording"), "{said}");
    let said = place.call("export run/summary.json --out csv").with_code(1).stderr();
    assert!(said.contains("expected results, found text (JSON)"), "{said}");
    assert!(!place.path("csv").exists());
    std::fs::hard_link(place.path("run.mcap"), place.path("hard.mcap")).unwrap();
    let said = replay(&place, "run.mcap --record hard.mcap").with_code(2).stderr();
    assert!(said.contains("the recording and --record: expected two files"), "{said}");
    let said = replay(&place, "run.mcap --record run.mcap").with_code(2).stderr();
    assert!(said.contains("run.mcap") || said.contains("reads"), "{said}");
    let said =
        place.run("--out run --force --record no/such/folder.mcap --steps 3").with_code(1).stderr();
    assert!(said.contains("folder.mcap"), "{said}");

    let mut bytes = std::fs::read(place.path("run.mcap")).unwrap();
    let key = b"\x06\0\0\0format\x01\0\0\x004";
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap() + key.len() - 1;
    bytes[at] = b'9';
    std::fs::write(place.path("run.mcap"), bytes).unwrap();
    verify(&place, "run.mcap").with_code(6);
}

#[test]
fn the_reply_of_a_window_can_be_put_together_from_its_messages() {
    let place = recorded();
    let (_, records) = contents(&place, "run.mcap");
    let record = &records[9];
    let mut messages = MessageReader::open(&place.path("run.mcap")).unwrap();
    let mut reply = AdvanceReply {
        seq: record.seq,
        t0_ns: record.t0_ns,
        t1_ns: record.t1_ns,
        steps: 1,
        hash: record.hash,
        ..AdvanceReply::default()
    };
    while let Some(message) = messages.next().unwrap() {
        if message.log_time != 10_000_000 {
            continue;
        }
        let (topic, data) = (&message.channel.topic, &message.data);
        if topic.ends_with("/impulse") {
            reply.bodies.push(from_cdr(data).unwrap());
        } else if topic.starts_with("/ballast/zone/") {
            reply.zones.push(from_cdr(data).unwrap());
        } else if topic == "/ballast/solver" {
            reply.solver = from_cdr(data).unwrap();
        } else if topic == "/ballast/energy" {
            reply.energy = from_cdr(data).unwrap();
        }
    }
    if reply.solver.steps_not_converged > 0 {
        reply.status = ballast_protocol::messages::ReplyStatus::Warn;
    }
    assert_eq!(reply.digest().unwrap(), record.reply_digest);
}

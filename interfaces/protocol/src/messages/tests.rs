//! Properties of every message type.

mod conversions;
mod imagined;

use super::catalogue::for_each;
use super::*;
use crate::{from_cdr, from_json, to_cdr, to_json};
use imagined::{Imagined, Shape};
use proptest::prelude::*;

/// Something to be done with each type.
pub(super) trait ForEach {
    fn visit<T: Message>(&mut self);
}

/// Fields of a definition in order: name, type.
fn fields(definition: &str) -> Vec<(String, String)> {
    let lines = definition.lines().map(|l| l.split('#').next().unwrap_or_default().trim());
    lines
        .filter(|line| !line.is_empty() && !line.contains('=') && !line.starts_with("MSG:"))
        .map(|line| {
            let mut words = line.split_whitespace();
            let kind = words.next().unwrap();
            let kind = kind.rsplit('/').next().unwrap().replace("byte", "uint8");
            (words.next().expect(line).to_string(), kind)
        })
        .collect()
}

struct Order(usize);

impl ForEach for Order {
    fn visit<T: Message>(&mut self) {
        self.0 += 1;
        let Shape::Struct { name, fields: found } = Imagined::shape_of::<T>() else {
            panic!("{} is no structure", T::NAME)
        };
        assert_eq!(T::NAME.rsplit('/').next(), Some(name));
        let found: Vec<(String, String)> =
            found.iter().map(|(name, shape)| (name.to_string(), shape.text())).collect();
        assert_eq!(found, fields(definition(T::NAME).unwrap()), "{}", T::NAME);
    }
}

#[test]
fn fields_stand_in_the_order_of_the_definitions() {
    let mut order = Order(0);
    for_each(&mut order);
    assert_eq!(order.0, 48);
}

#[test]
fn a_wrong_order_would_be_seen() {
    #[derive(serde::Deserialize)]
    #[allow(dead_code)]
    struct Turned {
        pose: Pose,
        time_ns: i64,
    }
    let Shape::Struct { fields: found, .. } = Imagined::shape_of::<Turned>() else { panic!() };
    let names: Vec<&str> = found.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["pose", "time_ns"]);
    assert_eq!(fields("int64 a # b\n# c\nuint8 D=1\nx/Y[] e\nbyte[16] f 3")[2].1, "uint8[16]");
}

#[test]
fn constants_are_those_of_the_definitions() {
    fn check(definition_of: &str, all: &[(u8, &str)]) {
        let text = definition(definition_of).unwrap();
        let constants = text.lines().filter(|l| l.starts_with("uint8 ") && l.contains('='));
        let found: Vec<String> = constants.map(str::to_string).collect();
        let expected: Vec<String> =
            all.iter().map(|(n, word)| format!("uint8 {}={n}", word.to_uppercase())).collect();
        assert_eq!(found, expected);
    }
    let interpolations: Vec<_> =
        InterpolationMode::ALL.iter().map(|v| (v.number(), v.word())).collect();
    check("ballast_msgs/BodyMotion", &interpolations);
    check("ballast_msgs/BodyLoad", &interpolations);
    let policies: Vec<_> = DeadlinePolicy::ALL.iter().map(|v| (v.number(), v.word())).collect();
    check("ballast_msgs/AdvanceRequest", &policies);
    let status: Vec<_> = ReplyStatus::ALL.iter().map(|v| (v.number(), v.word())).collect();
    check("ballast_msgs/AdvanceReply", &status);
}

/// Writes, reads, and reads what is damaged, all types with values of chance.
struct RoundTrip(u64);

impl ForEach for RoundTrip {
    fn visit<T: Message>(&mut self) {
        let message: T = Imagined::value(self.0);
        let bytes = to_cdr(&message).unwrap();
        let back: T = from_cdr(&bytes).unwrap();
        assert_eq!(to_cdr(&back).unwrap(), bytes, "{}", T::NAME);
        let json = to_json(&message).unwrap();
        let back: T = from_json(json.as_bytes()).unwrap_or_else(|e| panic!("{e}: {json}"));
        assert_eq!(to_cdr(&back).unwrap(), bytes, "{}: {json}", T::NAME);
        assert_eq!(decode_to_json(T::NAME, &bytes).unwrap(), serde_json::to_value(&back).unwrap());

        for end in 0..bytes.len() {
            let error = from_cdr::<T>(&bytes[..end]).err().expect("an end too early is noticed");
            assert!(error.place.starts_with(T::NAME), "{error}");
        }
        for rest in [&[1][..], &[0; 4]] {
            assert!(from_cdr::<T>(&[&bytes, rest].concat()).is_err(), "{}", T::NAME);
        }
    }
}

/// Reads any bytes; what can be read can be written and is the same.
struct Hostile(Vec<u8>);

impl ForEach for Hostile {
    fn visit<T: Message>(&mut self) {
        if let Ok(message) = from_cdr::<T>(&self.0) {
            let bytes = to_cdr(&message);
            assert!(bytes.is_ok_and(|b| b.len() <= self.0.len() + 7), "{}", T::NAME);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_type_survives_both_encodings(seed in any::<u64>()) {
        for_each(&mut RoundTrip(seed));
    }

    #[test]
    fn any_bytes_are_read_without_harm(
        little in any::<bool>(),
        bytes in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let mut all = vec![0, u8::from(little), 0, 0];
        all.extend(bytes);
        for_each(&mut Hostile(all));
    }

    #[test]
    fn a_changed_byte_is_read_without_harm(seed in any::<u64>(), at in 0..4000usize, to in any::<u8>()) {
        let request: AdvanceRequest = Imagined::value(seed);
        let mut bytes = to_cdr(&request).unwrap();
        let at = at % bytes.len();
        bytes[at] = to;
        let _ = from_cdr::<AdvanceRequest>(&bytes);
        let mut text = to_json(&request).unwrap().into_bytes();
        let at = at % text.len();
        text[at] = to;
        let _ = from_json::<AdvanceRequest>(&text);
    }
}

#[test]
fn a_schema_holds_each_type_once() {
    let text = schema::<WindowRecord>();
    let rule = format!("{}\nMSG: ", "=".repeat(80));
    let names: Vec<&str> =
        text.split(&rule).skip(1).map(|part| part.lines().next().unwrap()).collect();
    assert_eq!(
        names,
        [
            "ballast_msgs/AdvanceRequest",
            "ballast_msgs/BodyMotion",
            "ballast_msgs/MotionKnot",
            "geometry_msgs/Pose",
            "geometry_msgs/Point",
            "geometry_msgs/Quaternion",
            "geometry_msgs/Twist",
            "geometry_msgs/Vector3",
            "ballast_msgs/BodyLoad",
            "ballast_msgs/WrenchKnot",
            "geometry_msgs/Wrench",
            "ballast_msgs/StateHash",
        ]
    );
    assert!(text.starts_with(definition("ballast_msgs/msg/WindowRecord").unwrap()));
    assert!(definition("ballast_msgs/EmptyRequest").is_none());
}

struct Whole;

impl ForEach for Whole {
    fn visit<T: Message>(&mut self) {
        for (_, kind) in fields(&schema::<T>()) {
            let kind = kind.split('[').next().unwrap();
            let known = kind.starts_with(char::is_lowercase)
                || schema::<T>().contains(&format!("/{kind}\n"));
            assert!(known, "{}: no definition of {kind}", T::NAME);
        }
    }
}

#[test]
fn schemas_lack_nothing() {
    for_each(&mut Whole);
}

#[test]
fn json_reads_well() {
    let text = r#"{"run_id": "a", "seq": 1, "t0_ns": 0, "t1_ns": 1000000, "motions": [{
        "body": "tine_1", "interpolation": "linear", "knots": [{"time_ns": 0,
        "pose": {"position": {"x": 1, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "twist": {"linear": {"x": 0, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": 0}}}]}]}"#;
    let request: AdvanceRequest = from_json(text.as_bytes()).unwrap();
    assert_eq!(request.motions[0].interpolation, InterpolationMode::Linear);
    assert_eq!(request.deadline_policy, DeadlinePolicy::Finish);
    let hash = StateHash::from(0x0123_u128);
    assert_eq!(to_json(&hash).unwrap(), format!("\"{:032x}\"", 0x0123));
    assert_eq!(from_cdr::<StateHash>(&to_cdr(&hash).unwrap()).unwrap(), hash);

    for (wrong, place) in [
        (text.replace("linear\",", "square\","), "motions[0].interpolation"),
        (text.replace("\"y\": 0, \"z\": 0}, \"or", "\"y\": \"0\", \"z\": 0}, \"or"), "position.y"),
        (text.replace("allow_jump", "").replace("body", "bodi"), "motions[0]"),
        (format!("{text} 1"), "AdvanceRequest"),
        ("[".repeat(1000), "AdvanceRequest"),
        (r#""00""#.into(), "AdvanceRequest"),
    ] {
        let error = from_json::<AdvanceRequest>(wrong.as_bytes()).unwrap_err();
        assert!(error.place.contains(place), "{error}");
    }
    assert!(from_json::<StateHash>(b"\"+0000000000000000000000000000000\"").is_err());
}

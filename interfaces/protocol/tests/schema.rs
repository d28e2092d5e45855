//! The published schema takes what is asked and answered, and nothing else.

use ballast_protocol::lockstep::{
    AttachReply, AttachRequest, ErrorCode, InitRequest, ParameterUpdate, RequestError, RunPosition,
    StateName, StatusReport, WindowProgress,
};
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, BodyLoad, BodyMotion, BodySeries, MotionKnot, SqueezeReport,
    StepSeries, Vector3, WrenchImpulse, WrenchKnot, ZoneMeasurement,
};
use ballast_protocol::real_time::RealTimeMode;
use ballast_protocol::schema::control_plane_schema;
use boon::{Compiler, SchemaIndex, Schemas};
use serde::Serialize;
use serde_json::{Value, json};

/// The schema, compiled by a validator that knows nothing of us.
struct Validator {
    schemas: Schemas,
    compiler: Compiler,
}

const URL: &str = "http://localhost/protocol.json";

impl Validator {
    fn new() -> Self {
        let mut compiler = Compiler::new();
        compiler.add_resource(URL, control_plane_schema()).expect("a schema");
        Self { schemas: Schemas::new(), compiler }
    }

    fn find(&mut self, name: &str) -> SchemaIndex {
        let position = format!("{URL}#/$defs/{name}");
        self.compiler
            .compile(&position, &mut self.schemas)
            .unwrap_or_else(|e| panic!("{name}: {e:#}"))
    }

    fn takes(&mut self, name: &str, value: &impl Serialize) {
        let (index, value) = (self.find(name), serde_json::to_value(value).unwrap());
        let result = self.schemas.validate(&value, index);
        result.unwrap_or_else(|e| panic!("{name}: {e:#}\n{value:#}"));
    }

    fn refuses(&mut self, name: &str, value: &Value) {
        let index = self.find(name);
        assert!(self.schemas.validate(value, index).is_err(), "{name}: {value:#}");
    }
}

fn request() -> AdvanceRequest {
    AdvanceRequest {
        run_id: "run".into(),
        seq: 1,
        t1_ns: 1_000_000,
        motions: vec![BodyMotion {
            knots: vec![MotionKnot::default(); 2],
            ..BodyMotion::default()
        }],
        loads: vec![BodyLoad { knots: vec![WrenchKnot::default()], ..BodyLoad::default() }],
        ..AdvanceRequest::default()
    }
}

fn reply() -> AdvanceReply {
    let zone = ZoneMeasurement { compactness: f64::NAN, ..ZoneMeasurement::default() };
    let body = BodySeries { impulse: vec![Vector3::default()], ..BodySeries::default() };
    AdvanceReply {
        bodies: vec![WrenchImpulse::default()],
        zones: vec![zone],
        squeezes: vec![SqueezeReport { loop_force: vec![1.0], ..SqueezeReport::default() }],
        step_series: StepSeries { time_ns: vec![1], bodies: vec![body], ..StepSeries::default() },
        ..AdvanceReply::default()
    }
}

#[test]
fn what_is_written_is_taken() {
    let mut schema = Validator::new();
    let position =
        RunPosition { run_id: "run".into(), hash: "0".repeat(32), ..RunPosition::default() };
    schema.takes(
        "attach.request",
        &AttachRequest { client: "me".into(), ..AttachRequest::default() },
    );
    schema.takes(
        "attach.reply",
        &AttachReply { ticket: "t".into(), owner_count: 1, position: position.clone() },
    );
    schema.takes("init.request", &InitRequest { seed: Some(7), schedule: None });
    schema.takes("param.request", &ParameterUpdate { tolerance: Some(1e-4), ..Default::default() });
    let running = RealTimeMode { real_time_factor: 1.0, ..RealTimeMode::default() };
    for real_time in [Some(Some(running)), Some(None), None] {
        let ask = ParameterUpdate { real_time, ..ParameterUpdate::default() };
        schema.takes("param.request", &ask);
        let text = serde_json::to_string(&ask).unwrap();
        assert_eq!(serde_json::from_str::<ParameterUpdate>(&text).unwrap(), ask);
    }
    for verb in ["advance", "redo"] {
        schema.takes(&format!("{verb}.request"), &request());
        schema.takes(&format!("{verb}.reply"), &reply());
    }
    for verb in ["save", "restore", "drop"] {
        schema.takes(&format!("{verb}.request"), &StateName { name: "here".into() });
    }
    for verb in ["init", "save", "restore", "drop", "reset", "param", "detach", "shutdown"] {
        schema.takes(&format!("{verb}.reply"), &position);
    }
    for verb in ["describe", "reset", "status", "detach", "shutdown"] {
        schema.takes(&format!("{verb}.request"), &json!({}));
    }
    let status = StatusReport { owner: Some("me".into()), position, ..StatusReport::default() };
    schema.takes("status.reply", &status);
    // Before the first step of a window is done, what it takes is not known.
    let begun =
        serde_json::to_value(WindowProgress { steps: 1, ..WindowProgress::default() }).unwrap();
    assert_eq!((&begun["iterations"], &begun["remaining_ms"]), (&Value::Null, &Value::Null));
    schema.takes(
        "status.reply",
        &StatusReport { progress: Some(WindowProgress::default()), ..status },
    );
    let fault = RequestError {
        expected_seq: Some(3),
        ..RequestError::new(ErrorCode::OutOfSequence, "why")
    };
    schema.takes("refusal", &fault);
    // The shortest requests that are read.
    schema.takes("advance.request", &json!({"run_id": "r", "seq": 1, "t0_ns": 0, "t1_ns": 5}));
    schema.takes("param.request", &json!({}));
}

#[test]
fn what_is_not_read_is_refused() {
    let mut schema = Validator::new();
    let good = serde_json::to_value(request()).unwrap();
    let changed = |pointer: &str, value: Value| {
        let mut bad = good.clone();
        *bad.pointer_mut(pointer).expect(pointer) = value;
        bad
    };
    let mut more = good.clone();
    more["deadline"] = json!(5);
    for bad in [
        changed("/seq", json!(-1)),
        changed("/seq", json!("1")),
        changed("/t0_ns", json!(0.5)),
        changed("/motions/0/interpolation", json!("square")),
        changed("/motions/0/knots/1/pose/position/x", json!(null)),
        changed("/loads/0/knots/0", json!({"time_ns": 0})),
        changed("/deadline_policy", json!(1)),
        changed("/deadline_ms", json!(1_u64 << 32)),
        more,
        json!({"seq": 1}),
        json!([]),
    ] {
        schema.refuses("advance.request", &bad);
        let text = bad.to_string();
        let read = ballast_protocol::from_json::<AdvanceRequest>(text.as_bytes());
        assert!(read.is_err(), "refused by the schema, but read: {text}");
    }
    schema.refuses("attach.request", &json!({}));
    schema.refuses("save.request", &json!({"name": "x", "nam": "y"}));
    schema.refuses("param.request", &json!({"step_ns": 5}));
    schema.refuses("param.request", &json!({"max_iterations": 1_u64 << 32}));
    schema.refuses("init.request", &json!({"seed": -1}));
    schema.refuses("reset.request", &json!({"name": "x"}));
    schema.refuses("refusal", &json!({"code": "nothing_known", "message": ""}));
    schema.refuses("advance.reply", &json!({"hash": "12"}));
}

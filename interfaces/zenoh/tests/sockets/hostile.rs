//! Peers that send what no partner would.

use crate::common::scene::Random;
use crate::setup::{KEY, Served, WINDOW, shaking, step, times, undisturbed};
use ballast_protocol::lockstep::{ErrorCode, RequestError};
use ballast_protocol::messages::{AdvanceRequest, Message, MotionKnot};
use ballast_protocol::to_cdr;
use ballast_zenoh::{Keys, MAX_MESSAGE_BYTES, SessionConfig};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use zenoh::Wait;
use zenoh::bytes::Encoding;

/// Any Zenoh program.
pub struct Stranger {
    session: zenoh::Session,
    keys: Keys,
}

impl Stranger {
    pub fn at(link: &SessionConfig) -> Self {
        let stranger = Self { session: link.open().unwrap(), keys: Keys::of(KEY).unwrap() };
        // Connected when it gets an answer.
        for _ in 0..200 {
            if stranger.ask("status", b"", None).is_ok() {
                return stranger;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("no connection");
    }

    /// A token of a client, alive until it is dropped.
    pub fn come_alive(&self, client: &str) -> zenoh::liveliness::LivelinessToken {
        self.session.liveliness().declare_token(self.keys.owner(client)).wait().unwrap()
    }

    /// Becomes the owner: its token, its ticket, the run's id.
    pub fn attach(&self) -> (zenoh::liveliness::LivelinessToken, String, String) {
        let token = self.come_alive("raw");
        let attached = self.ask("attach", br#"{"client":"raw"}"#, None).unwrap();
        let attached: serde_json::Value = serde_json::from_slice(&attached).unwrap();
        let text = |key: &str| attached[key].as_str().unwrap().to_string();
        (token, text("ticket"), text("run_id"))
    }

    /// A sample of motion, without a ticket and with one that is none.
    pub fn put_motion(&self, body: &str, knot: &MotionKnot) {
        for ticket in ["", "0123456789abcdef0123456789abcdef"] {
            let put = self.session.put(self.keys.input(body), to_cdr(knot).unwrap());
            put.encoding(Encoding::from("application/cdr")).attachment(ticket).wait().unwrap();
        }
    }

    /// Sends any bytes with a ticket.
    pub fn put(&self, body: &str, bytes: Vec<u8>, ticket: &str) {
        let put = self.session.put(self.keys.input(body), bytes).attachment(ticket);
        put.encoding(Encoding::APPLICATION_JSON).wait().unwrap();
    }

    /// Returns the reply, the error, or a generic error without a reply.
    /// Asks for window 1, with the length of several windows, and does not wait: `then` gets the refusal, if it is one.
    pub fn ask_for_long(
        &self,
        windows: u64,
        run_id: String,
        ticket: &str,
        then: impl Fn(Option<RequestError>) + Send + Sync + 'static,
    ) {
        let long = windows * WINDOW;
        let motions = shaking(0, long);
        let (seq, t1_ns) = (1, long as i64);
        let request = AdvanceRequest { run_id, seq, t1_ns, motions, ..AdvanceRequest::default() };
        let text = ballast_protocol::to_json(&request).unwrap();
        self.ask_later("advance", text.into_bytes(), ticket, then);
    }

    /// Sends any request without waiting.
    pub fn ask_later(
        &self,
        verb: &str,
        payload: Vec<u8>,
        ticket: &str,
        then: impl Fn(Option<RequestError>) + Send + Sync + 'static,
    ) {
        let get = self.session.get(self.keys.control(verb)).payload(payload);
        let get = get.attachment(ticket).timeout(Duration::from_secs(120));
        let get = get.callback(move |reply| {
            let fault = reply.result().err().map(|e| e.payload().to_bytes().into_owned());
            then(fault.map(|bytes| serde_json::from_slice(&bytes).unwrap()));
        });
        get.wait().unwrap();
    }

    pub fn ask(
        &self,
        verb: &str,
        payload: &[u8],
        ticket: Option<&str>,
    ) -> Result<Vec<u8>, RequestError> {
        self.ask_as(verb, payload, ticket, Encoding::APPLICATION_JSON)
    }

    pub fn ask_as(
        &self,
        verb: &str,
        payload: &[u8],
        ticket: Option<&str>,
        encoding: Encoding,
    ) -> Result<Vec<u8>, RequestError> {
        let get = self.session.get(self.keys.control(verb)).timeout(Duration::from_secs(10));
        let get = get.payload(payload).encoding(encoding);
        let get = match ticket {
            Some(ticket) => get.attachment(ticket),
            None => get,
        };
        let replies = get.wait().unwrap();
        let none = || RequestError::new(ErrorCode::ErrorState, "no answer");
        match replies.recv().map_err(|_| none())?.into_result() {
            Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
            Err(error) => {
                Err(serde_json::from_slice(&error.payload().to_bytes()).unwrap_or_else(|_| none()))
            }
        }
    }
}

fn cdr() -> Encoding {
    Encoding::from(format!("application/cdr;{}", AdvanceRequest::NAME))
}

#[test]
fn random_bytes_are_refused_and_change_nothing() {
    let served = Served::new();
    let mut client = served.client();
    let stranger = Stranger::at(&served.link());
    let mut random = Random(11);
    let windows = times(100);
    for _ in 0..windows {
        step(&mut client).unwrap();
        let length = (random.next() * 300.0) as usize;
        let bytes: Vec<u8> = (0..length).map(|_| (random.next() * 256.0) as u8).collect();
        for verb in ["attach", "advance", "save", "param", "nonsense"] {
            let refused = stranger.ask(verb, &bytes, None);
            // Nothing is a good request, too: an empty object.
            assert!(refused.is_err() || bytes.is_empty(), "{verb}: {bytes:?}");
        }
    }
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn who_is_not_alive_does_not_drive_and_what_is_not_known_is_told() {
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let fault = stranger.ask("attach", br#"{"client":"ghost"}"#, None).unwrap_err();
    assert_eq!(fault.code, ErrorCode::NoLivelinessToken, "{fault}");
    assert!(
        fault.details.is_some_and(|f| f.expected.contains("owner/CLIENT") && f.found == "ghost")
    );
    let fault = stranger.ask("explode", b"", None).unwrap_err();
    assert_eq!(fault.code, ErrorCode::UnknownRequest, "{fault}");
    assert!(
        fault
            .details
            .is_some_and(|f| f.expected.contains("advance") && f.found.contains("explode"))
    );
}

#[test]
fn an_owner_that_sends_garbage_is_told_where_it_is_wrong() {
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let (_token, ticket, run_id) = stranger.attach();
    let request = AdvanceRequest {
        run_id,
        seq: 1,
        t1_ns: WINDOW as i64,
        motions: shaking(0, WINDOW),
        ..AdvanceRequest::default()
    };
    let good = to_cdr(&request).unwrap();
    let mut random = Random(5);
    let mut refused = 0;
    for _ in 0..times(200) {
        // A good request with some bytes changed, cut short.
        let mut bytes = good.clone();
        for _ in 0..1 + (random.next() * 4.0) as usize {
            let at = (random.next() * bytes.len() as f64) as usize;
            bytes[at] = (random.next() * 256.0) as u8;
        }
        bytes.truncate(1 + (random.next() * (bytes.len() - 1) as f64) as usize);
        match stranger.ask_as("advance", &bytes, Some(&ticket), cdr()) {
            Ok(_) => panic!("{bytes:?} was computed"),
            Err(fault) => {
                assert_ne!(fault.message, "no answer", "{bytes:?}");
                refused += 1;
            }
        }
    }
    assert_eq!(refused, times(200));
    // 2³¹ bodies and more, in a message that has none.
    let mut huge = to_cdr(&AdvanceRequest { motions: vec![], ..request.clone() }).unwrap();
    let one = to_cdr(&AdvanceRequest { motions: vec![Default::default()], ..request.clone() });
    // Where the count of bodies stands, the two differ first.
    let count = huge.iter().zip(&one.unwrap()).position(|(a, b)| a != b).unwrap();
    for k in 0..times(5) as u32 {
        huge[count..count + 4].copy_from_slice(&((1u32 << 31) + k).to_le_bytes());
        let fault = stranger.ask_as("advance", &huge, Some(&ticket), cdr()).unwrap_err();
        assert!(fault.code == ErrorCode::Malformed && fault.message.contains("motions"), "{fault}");
    }
    // Endless, deep.
    for size in [MAX_MESSAGE_BYTES + 1, 3 * MAX_MESSAGE_BYTES] {
        let endless = vec![b' '; size];
        let fault = stranger.ask("advance", &endless, Some(&ticket)).unwrap_err();
        assert_eq!(fault.code, ErrorCode::TooLarge, "{fault}");
    }
    let deep = "[".repeat(1 << 20);
    for verb in ["advance", "save"] {
        let fault = stranger.ask(verb, deep.as_bytes(), Some(&ticket)).unwrap_err();
        assert!(matches!(fault.code, ErrorCode::Malformed | ErrorCode::TooLarge), "{fault}");
    }
    // Every request says what is wrong with it, where, and what was expected.
    for (verb, text, place) in [
        ("attach", r#"{"client": 3}"#, "attach.client"),
        ("param", r#"{"max_iterations": "many"}"#, "param.max_iterations"),
        ("save", "{}", "save"),
        ("restore", r#"{"name": "here", "why": 1}"#, "restore.why"),
        ("init", r#"{"seed": -1}"#, "init.seed"),
    ] {
        let fault = stranger.ask(verb, text.as_bytes(), Some(&ticket)).unwrap_err();
        assert_eq!(fault.code, ErrorCode::Malformed, "{verb}: {fault}");
        let finding = fault.details.unwrap_or_default();
        assert_eq!(finding.place, place, "{finding:?}");
        assert!(!finding.expected.is_empty() && finding.found.contains("line 1"), "{finding:?}");
    }
    // After all this the good one is computed, in either encoding.
    let text = ballast_protocol::to_json(&request).unwrap();
    let reply = stranger.ask("advance", text.as_bytes(), Some(&ticket)).unwrap();
    let reply: serde_json::Value = serde_json::from_slice(&reply).unwrap();
    assert_eq!(reply["hash"].as_str(), Some(&undisturbed(1)[0][..]));
    stranger.ask_as("advance", &good, Some(&ticket), cdr()).unwrap();
    assert_eq!(served.stop().computed_windows(), 1);
}

#[test]
fn a_flood_of_requests_is_refused_and_holds_nobody_up() {
    let served = Served::new();
    let mut client = served.client();
    step(&mut client).unwrap();
    let stranger = Stranger::at(&served.link());
    let flood = std::thread::spawn(move || {
        let counts = Arc::new([const { AtomicU64::new(0) }; 2]);
        let many = 20_000;
        for k in 0..many {
            let verb = ["status", "attach", "advance", "param"][k % 4];
            let to = Arc::clone(&counts);
            let get = stranger.session.get(stranger.keys.control(verb));
            let get = get.payload(r#"{"client":"unknown"}"#).callback(move |reply| {
                let bytes = reply.result().err().map(|e| e.payload().to_bytes().into_owned());
                let is_flood = bytes.is_some_and(|b| {
                    serde_json::from_slice(&b)
                        .is_ok_and(|f: RequestError| f.code == ErrorCode::TooManyRequests)
                });
                to[usize::from(is_flood)].fetch_add(1, Ordering::SeqCst);
            });
            get.timeout(Duration::from_secs(60)).wait().unwrap();
        }
        let begin = Instant::now();
        loop {
            let [answered, refused] = [0, 1].map(|k| counts[k].load(Ordering::SeqCst));
            if answered + refused == many as u64 {
                return (answered, refused);
            }
            assert!(begin.elapsed() < Duration::from_secs(60), "{answered} and {refused}");
            std::thread::sleep(Duration::from_millis(10));
        }
    });
    let mut windows = 1;
    let mut longest = Duration::ZERO;
    while !flood.is_finished() {
        let begin = Instant::now();
        step(&mut client).unwrap();
        longest = longest.max(begin.elapsed());
        windows += 1;
        std::thread::sleep(Duration::from_millis(2));
    }
    // Every one of them is answered, most with a refusal.
    let (answered, refused) = flood.join().unwrap();
    assert!(answered > 0 && refused > 0, "{answered}, {refused}");
    assert!(longest < Duration::from_secs(3), "{longest:?}");
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn an_owner_that_floods_is_refused_what_does_not_fit() {
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let (_token, ticket, run_id) = stranger.attach();
    // A window that takes a while, and behind it a thousand requests.
    let (sender, answers) = channel();
    let told = || {
        let sender = sender.clone();
        move |fault| drop(sender.send(fault))
    };
    stranger.ask_for_long(500, run_id, &ticket, told());
    for _ in 0..1000 {
        stranger.ask_later("save", br#"{"name":"x"}"#.to_vec(), &ticket, told());
    }
    let begin = Instant::now();
    let mut refused = 0;
    for _ in 0..1001 {
        let left = Duration::from_secs(60).saturating_sub(begin.elapsed());
        if let Some(fault) = answers.recv_timeout(left).expect("an answer to each") {
            assert_eq!(fault.code, ErrorCode::TooManyRequests, "{fault}");
            refused += 1;
        }
    }
    assert!(refused > 800, "{refused}");
}

#[test]
fn bytes_that_are_no_zenoh_do_not_disturb() {
    let served = Served::new();
    let mut client = served.client();
    let address = served.endpoint.trim_start_matches("tcp/").to_string();
    let mut random = Random(3);
    let windows = times(60);
    let mut open = vec![];
    for _ in 0..windows {
        let mut socket = std::net::TcpStream::connect(&address).unwrap();
        let bytes: Vec<u8> = (0..200).map(|_| (random.next() * 256.0) as u8).collect();
        let _ = socket.write_all(&bytes);
        // Half of them stay open and say no more.
        if random.next() < 0.5 {
            open.push(socket);
        } else {
            socket.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            let _ = socket.read(&mut [0; 16]);
        }
        step(&mut client).unwrap();
    }
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

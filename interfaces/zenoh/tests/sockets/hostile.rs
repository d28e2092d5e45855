//! Peers that send what no partner would.

use crate::common::scene::Random;
use crate::setup::{KEY, Served, WINDOW, shaking, step, times, undisturbed};
use ballast_protocol::lockstep::{Code, Fault};
use ballast_protocol::messages::{AdvanceRequest, Message};
use ballast_protocol::to_cdr;
use ballast_zenoh::{Keys, LARGEST_MESSAGE, Link};
use std::io::{Read, Write};
use std::time::Duration;
use zenoh::Wait;
use zenoh::bytes::Encoding;

/// Any Zenoh program.
pub struct Stranger {
    session: zenoh::Session,
    keys: Keys,
}

impl Stranger {
    pub fn at(link: &Link) -> Self {
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

    /// The answer, the refusal, or a refusal of no code of ours where there is no answer.
    pub fn ask(&self, verb: &str, payload: &[u8], ticket: Option<&str>) -> Result<Vec<u8>, Fault> {
        self.ask_as(verb, payload, ticket, Encoding::APPLICATION_JSON)
    }

    pub fn ask_as(
        &self,
        verb: &str,
        payload: &[u8],
        ticket: Option<&str>,
        encoding: Encoding,
    ) -> Result<Vec<u8>, Fault> {
        let get = self.session.get(self.keys.control(verb)).timeout(Duration::from_secs(10));
        let get = get.payload(payload).encoding(encoding);
        let get = match ticket {
            Some(ticket) => get.attachment(ticket),
            None => get,
        };
        let replies = get.wait().unwrap();
        let none = || Fault::new(Code::InError, "no answer");
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
    assert_eq!(client.place().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn an_owner_that_sends_garbage_is_told_where_it_is_wrong() {
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let token = stranger.session.liveliness().declare_token(stranger.keys.owner("raw")).wait();
    let attached = stranger.ask("attach", br#"{"client":"raw"}"#, None).unwrap();
    let attached: serde_json::Value = serde_json::from_slice(&attached).unwrap();
    let ticket = attached["ticket"].as_str().unwrap();
    let request = AdvanceRequest {
        run_id: attached["run_id"].as_str().unwrap().into(),
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
        match stranger.ask_as("advance", &bytes, Some(ticket), cdr()) {
            Ok(_) => panic!("{bytes:?} was computed"),
            Err(fault) => {
                assert_ne!(fault.message, "no answer", "{bytes:?}");
                refused += 1;
            }
        }
    }
    assert_eq!(refused, times(200));
    // 2³¹ bodies, in a message that has none.
    let mut huge = to_cdr(&AdvanceRequest { motions: vec![], ..request.clone() }).unwrap();
    let one = to_cdr(&AdvanceRequest { motions: vec![Default::default()], ..request.clone() });
    // Where the count of bodies stands, the two differ first.
    let count = huge.iter().zip(&one.unwrap()).position(|(a, b)| a != b).unwrap();
    huge[count..count + 4].copy_from_slice(&(1u32 << 31).to_le_bytes());
    let fault = stranger.ask_as("advance", &huge, Some(ticket), cdr()).unwrap_err();
    assert!(fault.code == Code::Malformed && fault.message.contains("motions"), "{fault}");
    // Endless, deep.
    let endless = vec![b' '; LARGEST_MESSAGE + 1];
    let fault = stranger.ask("advance", &endless, Some(ticket)).unwrap_err();
    assert_eq!(fault.code, Code::TooLarge, "{fault}");
    let deep = "[".repeat(1 << 20);
    for verb in ["advance", "save"] {
        let fault = stranger.ask(verb, deep.as_bytes(), Some(ticket)).unwrap_err();
        assert!(matches!(fault.code, Code::Malformed | Code::TooLarge), "{fault}");
    }
    // After all this the good one is computed, in either encoding.
    let text = ballast_protocol::to_json(&request).unwrap();
    let reply = stranger.ask("advance", text.as_bytes(), Some(ticket)).unwrap();
    let reply: serde_json::Value = serde_json::from_slice(&reply).unwrap();
    assert_eq!(reply["hash"].as_str(), Some(&undisturbed(1)[0][..]));
    stranger.ask_as("advance", &good, Some(ticket), cdr()).unwrap();
    drop(token);
    assert_eq!(served.stop().answered_count(), 1);
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
    assert_eq!(client.place().hash, undisturbed(windows)[windows as usize - 1]);
}

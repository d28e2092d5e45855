//! A wire that can be cut, can fall silent, can be full, can lose what comes back, and can be slow.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const OPEN: u8 = 0;
/// Connections end, new ones are refused.
const CUT: u8 = 1;
/// Drops everything without an error.
const SILENT: u8 = 2;
/// Nothing comes back.
const DEAF: u8 = 3;
/// Takes nothing more of the client.
const FULL: u8 = 4;

/// Forwards connections to `to`.
pub struct Proxy {
    pub endpoint: String,
    wire: Arc<Wire>,
}

#[derive(Default)]
struct Wire {
    state: AtomicU8,
    /// Time that a piece takes, µs; pieces are of 64 KiB at most.
    pace_us: AtomicU32,
    connections: AtomicU32,
    sockets: Mutex<Vec<TcpStream>>,
}

impl Proxy {
    /// `to`: an endpoint `tcp/…`.
    pub fn before(to: &str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let wire = Arc::<Wire>::default();
        let (to, at) = (to.trim_start_matches("tcp/").to_string(), Arc::clone(&wire));
        std::thread::spawn(move || {
            for from in listener.incoming().map_while(Result::ok) {
                if at.state.load(Ordering::SeqCst) != OPEN {
                    continue;
                }
                let Ok(up) = TcpStream::connect(&to) else { continue };
                at.connections.fetch_add(1, Ordering::SeqCst);
                let mut sockets = at.sockets.lock().unwrap();
                for (a, b, back) in [(&from, &up, false), (&up, &from, true)] {
                    let (a, b, at) =
                        (a.try_clone().unwrap(), b.try_clone().unwrap(), Arc::clone(&at));
                    a.set_nodelay(true).unwrap();
                    std::thread::spawn(move || forward(a, b, back, &at));
                }
                sockets.extend([from, up]);
            }
        });
        Self { endpoint, wire }
    }

    /// A megabyte takes so long from now on.
    pub fn slow_down(&self, megabyte: Duration) {
        let pace = megabyte / 16;
        self.wire.pace_us.store(pace.as_micros() as u32, Ordering::SeqCst);
    }

    /// Returns the number of connections.
    pub fn connections(&self) -> u32 {
        self.wire.connections.load(Ordering::SeqCst)
    }

    pub fn cut(&self) {
        self.wire.state.store(CUT, Ordering::SeqCst);
        for socket in self.wire.sockets.lock().unwrap().drain(..) {
            let _ = socket.shutdown(Shutdown::Both);
        }
    }

    pub fn fall_silent(&self) {
        self.wire.state.store(SILENT, Ordering::SeqCst);
    }

    /// Takes nothing of the client from now on, while all of the component still comes back.
    pub fn fill_up(&self) {
        self.wire.state.store(FULL, Ordering::SeqCst);
    }

    /// Drops replies from now on.
    pub fn lose_answers(&self) {
        self.wire.state.store(DEAF, Ordering::SeqCst);
    }

    pub fn restore(&self) {
        self.wire.state.store(OPEN, Ordering::SeqCst);
    }
}

fn forward(mut from: TcpStream, mut to: TcpStream, back: bool, wire: &Wire) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        let is_held = || match wire.state.load(Ordering::SeqCst) {
            SILENT => true,
            FULL => !back,
            _ => false,
        };
        while is_held() {
            std::thread::sleep(Duration::from_millis(5));
        }
        if back && wire.state.load(Ordering::SeqCst) == DEAF {
            continue;
        }
        let share = count as f64 / buffer.len() as f64;
        let pace = Duration::from_micros(wire.pace_us.load(Ordering::SeqCst).into());
        std::thread::sleep(pace.mul_f64(share));
        if to.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}

//! Address on which a live view is served.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

/// Address on which a live view is served; `PORT` alone is on the loopback.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViewerAddress {
    /// Name or IP address; one of version 6 in brackets.
    pub(crate) host: String,
    /// Port; 0: any that is free.
    pub(crate) port: u16,
}

impl ViewerAddress {
    /// Returns true if only programs on this computer reach the address.
    pub fn is_loopback(&self) -> bool {
        let ip = self.host.trim_matches(['[', ']']).parse::<IpAddr>();
        ip.map_or(self.host == "localhost", |ip| ip.is_loopback())
    }
}

impl FromStr for ViewerAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let loopback = Ipv4Addr::LOCALHOST.to_string();
        let (host, port) = text.rsplit_once(':').unwrap_or((&loopback, text));
        let in_brackets = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
        let is_host = match in_brackets {
            Some(ip) => ip.parse::<Ipv6Addr>().is_ok(),
            None => !host.is_empty() && !host.contains([':', '/', '[', ']']),
        };
        match port.parse() {
            Ok(port) if is_host => Ok(Self { host: host.into(), port }),
            _ => Err(format!("expected HOST:PORT or PORT, such as 127.0.0.1:8765, found {text:?}")),
        }
    }
}

impl fmt::Display for ViewerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_without_a_host_are_on_the_loopback() {
        for (text, read, is_loopback) in [
            ("8765", "127.0.0.1:8765", true),
            ("localhost:0", "localhost:0", true),
            ("[::1]:80", "[::1]:80", true),
            ("0.0.0.0:8765", "0.0.0.0:8765", false),
            ("track.example:8765", "track.example:8765", false),
        ] {
            let address: ViewerAddress = text.parse().unwrap();
            assert_eq!((address.to_string().as_str(), address.is_loopback()), (read, is_loopback));
        }
        for bad in
            ["", "nowhere", ":80", "::1", "[]x:80", "host:99999", "tcp/127.0.0.1:80", "ws://a:80"]
        {
            let message = bad.parse::<ViewerAddress>().unwrap_err();
            assert!(message.contains("expected HOST:PORT") && message.contains(bad), "{message}");
        }
    }
}

//! Access control by the configuration of Zenoh: certificates on both sides, users with passwords.

use crate::setup::{KEY, Served, lockstep, patient, step, undisturbed};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Error, SessionConfig, Timeouts};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// An authority, and what it has signed.
struct Authority {
    issuer: CertifiedIssuer<'static, KeyPair>,
}

impl Authority {
    fn new() -> Self {
        let mut params = CertificateParams::new(vec![]).unwrap();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().unwrap();
        Self { issuer: CertifiedIssuer::self_signed(params, key).unwrap() }
    }

    /// Writes certificate and key of `name`: their paths.
    fn sign(&self, folder: &Path, name: &str) -> [PathBuf; 2] {
        let key = KeyPair::generate().unwrap();
        let params = CertificateParams::new(vec!["localhost".into()]).unwrap();
        let certificate = params.signed_by(&key, &self.issuer).unwrap();
        [("pem", certificate.pem()), ("key", key.serialize_pem())]
            .map(|(extension, text)| write(folder, &format!("{name}.{extension}"), &text))
    }

    fn write(&self, folder: &Path, name: &str) -> PathBuf {
        write(folder, name, &self.issuer.pem())
    }
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// A configuration file that trusts `authority`, and shows `own`.
fn tls(
    folder: &Path,
    name: &str,
    authority: &Path,
    own: Option<&[PathBuf; 2]>,
    listen: bool,
) -> SessionConfig {
    let own = own.map_or(String::new(), |[certificate, key]| {
        if listen {
            format!("listen_certificate: {certificate:?}, listen_private_key: {key:?},")
        } else {
            format!("connect_certificate: {certificate:?}, connect_private_key: {key:?},")
        }
    });
    let text = format!(
        "{{ mode: \"peer\", scouting: {{ multicast: {{ enabled: false }} }}, listen: {{ endpoints: [] }},
           transport: {{ link: {{ tls: {{ root_ca_certificate: {authority:?}, enable_mtls: true, {own} }} }} }} }}"
    );
    SessionConfig::from_file(write(folder, name, &text))
}

#[test]
fn without_a_certificate_of_the_authority_there_is_no_connection() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (ours, theirs) = (Authority::new(), Authority::new());
    let authority = ours.write(folder, "authority.pem");
    let [server, client] = ["server", "client"].map(|name| ours.sign(folder, name));
    let forged = theirs.sign(folder, "forged");
    let free = free_endpoint().unwrap();
    let port = free.rsplit(':').next().unwrap();
    let listen = SessionConfig {
        listen: vec![format!("tls/localhost:{port}")],
        ..tls(folder, "server.json5", &authority, Some(&server), true)
    };
    let _served = Served::at(&listen, lockstep());
    let connect = |name: &str, own: Option<&[PathBuf; 2]>| SessionConfig {
        connect: vec![format!("tls/localhost:{port}")],
        ..tls(folder, name, &authority, own, false)
    };
    let hasty = Timeouts { disconnect: Duration::from_millis(2500), ..Timeouts::default() };
    for (name, own) in [("none.json5", None), ("forged.json5", Some(&forged))] {
        let error = Client::attach(KEY, &connect(name, own), "test", None, hasty).err().unwrap();
        assert!(
            matches!(error, Error::Disconnected { .. } | Error::Transport { .. }),
            "{name}: {error}"
        );
    }
    // Without TLS at all.
    let plain = SessionConfig::connect_to(format!("tcp/localhost:{port}"));
    let error = Client::attach(KEY, &plain, "test", None, hasty).err().unwrap();
    assert!(matches!(error, Error::Disconnected { .. }), "{error}");
    let good = connect("client.json5", Some(&client));
    let mut client = Client::attach(KEY, &good, "test", None, patient()).unwrap();
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(1)[0]);
}

#[test]
fn without_the_password_there_is_no_connection() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let users = write(folder, "users.txt", "machine:right\nbed:bed\n");
    let configured = |name: &str, auth: String| {
        let text = format!(
            "{{ mode: \"peer\", scouting: {{ multicast: {{ enabled: false }} }}, listen: {{ endpoints: [] }},
               transport: {{ auth: {{ usrpwd: {{ {auth} }} }} }} }}"
        );
        SessionConfig::from_file(write(folder, name, &text))
    };
    let listen = SessionConfig {
        listen: vec![free_endpoint().unwrap()],
        ..configured(
            "bed.json5",
            format!("user: \"bed\", password: \"bed\", dictionary_file: {users:?}"),
        )
    };
    let served = Served::at(&listen, lockstep());
    let connect = |name: &str, auth: &str| SessionConfig {
        connect: vec![served.endpoint.clone()],
        ..configured(name, auth.into())
    };
    let hasty = Timeouts { disconnect: Duration::from_millis(2500), ..Timeouts::default() };
    let wrong = connect("wrong.json5", "user: \"machine\", password: \"wrong\"");
    for link in [wrong, served.link()] {
        let error = Client::attach(KEY, &link, "test", None, hasty).err().unwrap();
        assert!(matches!(error, Error::Disconnected { .. } | Error::Transport { .. }), "{error}");
    }
    let right = connect("right.json5", "user: \"machine\", password: \"right\"");
    let mut client = Client::attach(KEY, &right, "test", None, patient()).unwrap();
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(1)[0]);
}

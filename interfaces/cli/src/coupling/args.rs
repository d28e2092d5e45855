//! The command line of what speaks over Zenoh.

use crate::args::{BedCacheArgs, OverrideArgs};
use ballast_zenoh::SessionConfig;
use clap::Args;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

/// How to reach others, as for any Zenoh program.
#[derive(Debug, Clone, Args)]
pub struct Endpoints {
    /// Connect to this endpoint (tcp/HOST:PORT); may be given several times
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Be a client of the Zenoh router at this endpoint, through which partners find each other
    #[arg(long, value_name = "ENDPOINT", conflicts_with_all = ["connect", "listen"])]
    pub router: Option<String>,
    /// Listen on this endpoint; may be given several times
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Zenoh configuration (JSON5): TLS, users, scouting, and everything else
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

impl Endpoints {
    fn link(&self) -> SessionConfig {
        let Self { connect, router, listen, config } = self.clone();
        SessionConfig { config, listen, connect, router, ..SessionConfig::default() }
    }

    /// For those who are looked for: without a word, on the loopback.
    pub fn to_listen(&self) -> SessionConfig {
        self.link().or_listen_on_default()
    }

    /// For those who look: without a word, on the loopback.
    pub fn to_connect(&self) -> SessionConfig {
        self.link().or_connect_to_default()
    }
}

#[derive(Debug, Args)]
pub struct ServeArgs {
    /// Case file (TOML)
    pub case: PathBuf,
    /// Name of the component, SITE/ID
    #[arg(long, value_name = "SITE/ID")]
    pub key: String,
    #[command(flatten)]
    pub endpoints: Endpoints,
    /// Folder of the run's files; by default runs/<name of the case>-serve
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Go on from the checkpoint in the folder, if there is one
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Start over even if the folder holds the checkpoint of another run
    #[arg(long)]
    pub force: bool,
    /// Write a checkpoint if the last one is so old, s of wall time, and something has changed; 0: after every window
    #[arg(long, value_name = "S", default_value = "30", value_parser = seconds)]
    pub checkpoint_every: Duration,
    /// Send pictures for viewers from a session of its own that listens here (tcp/127.0.0.1:7448)
    #[arg(long, value_name = "ENDPOINT")]
    pub viewer: Option<String>,
    /// Shortest time between two pictures, s of wall time
    #[arg(long, value_name = "S", default_value = "0.2", value_parser = seconds, requires = "viewer")]
    pub viewer_interval: Duration,
    /// Wait until a partner asks for `init` before the bed is prepared
    #[arg(long)]
    pub defer_init: bool,
    /// Record the run in an MCAP file, which is replaced; with --resume the next free NAME.2.mcap, NAME.3.mcap
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct DescribeArgs {
    /// Name of the component, SITE/ID
    #[arg(value_name = "SITE/ID")]
    pub key: String,
    #[command(flatten)]
    pub endpoints: Endpoints,
    /// Print the JSON Schema of its requests and replies instead
    #[arg(long)]
    pub schema: bool,
}

#[derive(Debug, Args)]
pub struct TopArgs {
    /// Name of the component, SITE/ID
    #[arg(value_name = "SITE/ID")]
    pub key: String,
    #[command(flatten)]
    pub endpoints: Endpoints,
    /// End after so many pictures, two per second
    #[arg(long, value_name = "N")]
    pub count: Option<NonZeroU32>,
}

#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Case file (TOML) to look at, too
    pub case: Option<PathBuf>,
    /// Component that should be there, SITE/ID
    #[arg(long, value_name = "SITE/ID")]
    pub key: Option<String>,
    #[command(flatten)]
    pub endpoints: Endpoints,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let s = text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    s.ok_or_else(|| "expected seconds, 0 or more".into())
}

//! The command line of the commands that use Zenoh.

use crate::args::{BedCacheArgs, OverrideArgs, seconds};
use ballast_foxglove::ViewerAddress;
use ballast_zenoh::SessionConfig;
use clap::Args;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

/// Endpoints of the Zenoh session.
#[derive(Debug, Clone, Args)]
pub struct Endpoints {
    /// Connect to this endpoint (tcp/HOST:PORT); can be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Connect as client to the Zenoh router at this endpoint
    #[arg(long, value_name = "ENDPOINT", conflicts_with_all = ["connect", "listen"])]
    pub router: Option<String>,
    /// Listen on this endpoint; can be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Zenoh configuration file (JSON5), for TLS, users, scouting and other settings
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

impl Endpoints {
    fn session_config(&self) -> SessionConfig {
        let Self { connect, router, listen, config } = self.clone();
        SessionConfig { config, listen, connect, router, ..SessionConfig::default() }
    }

    /// Returns the configuration of a server, which listens on the loopback by default.
    pub fn to_listen(&self) -> SessionConfig {
        self.session_config().or_listen_on_default()
    }

    /// Returns the configuration of a client, which connects to the loopback by default.
    pub fn to_connect(&self) -> SessionConfig {
        self.session_config().or_connect_to_default()
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
    /// Folder of the run's files (default: runs/<name of the case>-serve)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Continue from the checkpoint in the folder, if there is one
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Replace the checkpoint of another run in the folder
    #[arg(long)]
    pub force: bool,
    /// Minimum wall time between checkpoints in seconds (0: after every window)
    #[arg(long, value_name = "S", default_value = "30", value_parser = seconds)]
    pub checkpoint_interval: Duration,
    /// Publish pictures for viewers in a separate session that listens on this endpoint (tcp/127.0.0.1:7448)
    #[arg(long, value_name = "ENDPOINT")]
    pub viewer: Option<String>,
    /// Minimum wall time between two pictures in seconds
    #[arg(long, value_name = "S", default_value = "0.2", value_parser = seconds, requires = "viewer")]
    pub viewer_interval: Duration,
    /// Show the run live in Foxglove viewers that connect to this address: HOST:PORT, or PORT on this computer
    #[arg(long, value_name = "ADDRESS")]
    pub foxglove: Option<ViewerAddress>,
    /// Prepare the bed only at the `init` request of a partner
    #[arg(long)]
    pub defer_init: bool,
    /// Record the run in this MCAP file, which is replaced; with --resume in the next free NAME.2.mcap, NAME.3.mcap
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
}

/// Component that computes the bed of a co-simulation unit.
#[derive(Debug, Args)]
pub struct UnitServerArgs {
    /// Write a unit without bed that steps this served component, SITE/ID, at the endpoints below
    #[arg(long, value_name = "SITE/ID")]
    pub served: Option<String>,
    #[command(flatten)]
    pub endpoints: Endpoints,
}

#[derive(Debug, Args)]
pub struct DescribeArgs {
    /// Name of the component, SITE/ID
    #[arg(value_name = "SITE/ID")]
    pub key: String,
    #[command(flatten)]
    pub endpoints: Endpoints,
    /// Print the JSON Schema of requests and replies instead
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
    /// End after this number of tables, two per second
    #[arg(long, value_name = "N")]
    pub count: Option<NonZeroU32>,
}

#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Case file (TOML) to check
    pub case: Option<PathBuf>,
    /// Component to connect to, SITE/ID
    #[arg(long, value_name = "SITE/ID")]
    pub key: Option<String>,
    #[command(flatten)]
    pub endpoints: Endpoints,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

//! Key expressions of a component: `ballast/1/<site>/<id>/…`.

use crate::Error;

/// Major version of the protocol.
pub use ballast_protocol::description::PROTOCOL_VERSION as VERSION;

/// Parameter of a `describe` query that requests the JSON Schema.
pub(crate) const SCHEMA: &str = "schema";

/// Key expressions of one component.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    name: String,
    base: String,
}

impl Keys {
    /// Creates the keys of the component `site/id`; both parts consist of letters, digits, `-`, `_` and `.`.
    ///
    /// # Errors
    /// [`Error::InvalidName`].
    pub fn of(name: &str) -> Result<Self, Error> {
        let parts: Vec<&str> = name.split('/').collect();
        let good = |p: &&str| {
            !p.is_empty() && p.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b))
        };
        if parts.len() == 2 && parts.iter().all(good) {
            return Ok(Self { name: name.into(), base: format!("ballast/{VERSION}/{name}") });
        }
        let expected = "SITE/ID of letters, digits, '-', '_' and '.'";
        Err(Error::InvalidName { expected, found: name.into() })
    }

    /// Returns the name `site/id`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the key of the liveliness token of a run.
    pub fn alive(&self, run_id: &str) -> String {
        format!("{}/alive/{run_id}", self.base)
    }

    /// Returns the pattern of the liveliness tokens of all runs.
    pub fn alive_any(&self) -> String {
        format!("{}/alive/*", self.base)
    }

    /// Returns the key of the liveliness token of a client.
    pub fn owner(&self, client: &str) -> String {
        format!("{}/owner/{client}", self.base)
    }

    /// Returns the pattern of the liveliness tokens of all clients.
    pub fn owner_any(&self) -> String {
        format!("{}/owner/*", self.base)
    }

    /// Returns the key of the description.
    pub fn describe(&self) -> String {
        format!("{}/describe", self.base)
    }

    /// Returns the key of a request: `attach`, `advance`, …
    pub fn control(&self, verb: &str) -> String {
        format!("{}/ctl/{verb}", self.base)
    }

    /// Returns the pattern of all requests.
    pub fn control_any(&self) -> String {
        format!("{}/ctl/*", self.base)
    }

    /// Returns the key of a body's motion samples in real-time mode.
    pub fn input(&self, body: &str) -> String {
        format!("{}/in/{}/motion", self.base, key_segment(body))
    }

    /// Returns the pattern of the motion samples of all bodies.
    pub(crate) fn input_any(&self) -> String {
        format!("{}/in/*/motion", self.base)
    }

    /// Returns the key of a visualization: `grains` or `scene`.
    pub fn visualization(&self, what: &str) -> String {
        format!("{}/viz/{what}", self.base)
    }

    /// Returns the pattern of all published keys.
    pub fn out_any(&self) -> String {
        format!("{}/out/**", self.base)
    }

    /// Returns a published key of the component: `clock`, `status`, …
    pub fn out(&self, what: &str) -> String {
        format!("{}/out/{what}", self.base)
    }

    /// Returns a published key of a body: `pose`, `twist`, `wrench`, `impulse`.
    pub fn out_body(&self, body: &str, what: &str) -> String {
        format!("{}/out/{}/{what}", self.base, key_segment(body))
    }

    /// Returns the published key of the squeezes of a pair of tines.
    pub fn out_squeeze(&self, pair: &str) -> String {
        format!("{}/out/squeeze/{}", self.base, key_segment(pair))
    }

    /// Returns the published key of a zone of the bed.
    pub fn out_zone(&self, zone: &str) -> String {
        format!("{}/out/zone/{}", self.base, key_segment(zone))
    }
}

/// Converts a name to a key segment: characters with a meaning in keys become `_`.
pub(crate) fn key_segment(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let chunk: String = name.chars().map(plain).collect();
    if chunk.is_empty() { "_".into() } else { chunk }
}

/// Returns the last segment of a key.
pub(crate) fn last_segment(key: &str) -> &str {
    key.rsplit('/').next().unwrap_or(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_be_patterns_are_refused() {
        for bad in ["", "site", "/id", "site/", "a/b/c", "a/*", "a/$x", "a b/c", "ä/b", "a/?"] {
            let error = Keys::of(bad).unwrap_err().to_string();
            assert!(error.contains("SITE/ID") && error.contains(bad), "{error}");
        }
        let keys = Keys::of("yard/ballast-1").unwrap();
        assert_eq!(keys.control("advance"), "ballast/1/yard/ballast-1/ctl/advance");
        assert_eq!(
            keys.out_body("tine 1/a*", "pose"),
            "ballast/1/yard/ballast-1/out/tine_1_a_/pose"
        );
    }
}

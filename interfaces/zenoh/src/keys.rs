//! The key expressions of a component: `ballast/1/<site>/<id>/…`.

use crate::Error;

/// Major version of the messages.
pub use ballast_protocol::description::PROTOCOL_VERSION as VERSION;

/// The parameter of a `describe` query that asks for the schema of requests and replies.
pub(crate) const SCHEMA: &str = "schema";

/// The names of one component.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    name: String,
    base: String,
}

impl Keys {
    /// Of the component `site/id`; both parts are letters, digits, `-`, `_` and `.`.
    ///
    /// # Errors
    /// Anything else.
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

    /// `site/id`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Liveliness of the component in a run.
    pub fn alive(&self, run_id: &str) -> String {
        format!("{}/alive/{run_id}", self.base)
    }

    /// Liveliness of the component in any run.
    pub fn alive_any(&self) -> String {
        format!("{}/alive/*", self.base)
    }

    /// Liveliness of a client that drives or wants to.
    pub fn owner(&self, client: &str) -> String {
        format!("{}/owner/{client}", self.base)
    }

    /// Liveliness of any such client.
    pub fn owner_any(&self) -> String {
        format!("{}/owner/*", self.base)
    }

    /// What the component says of itself.
    pub fn describe(&self) -> String {
        format!("{}/describe", self.base)
    }

    /// A request: `attach`, `advance`, …
    pub fn control(&self, verb: &str) -> String {
        format!("{}/ctl/{verb}", self.base)
    }

    /// All requests.
    pub fn control_any(&self) -> String {
        format!("{}/ctl/*", self.base)
    }

    /// Where a body's motion comes in while time runs by itself.
    pub fn input(&self, body: &str) -> String {
        format!("{}/in/{}/motion", self.base, chunk(body))
    }

    /// Where any body's motion comes in.
    pub(crate) fn input_any(&self) -> String {
        format!("{}/in/*/motion", self.base)
    }

    /// Pictures: `grains`, `scene`.
    pub fn picture(&self, what: &str) -> String {
        format!("{}/viz/{what}", self.base)
    }

    /// All that is told.
    pub fn out_any(&self) -> String {
        format!("{}/out/**", self.base)
    }

    /// What is told of the component: `clock`, `status`, …
    pub fn out(&self, what: &str) -> String {
        format!("{}/out/{what}", self.base)
    }

    /// What is told of a body: `pose`, `twist`, `wrench`, `impulse`.
    pub fn out_body(&self, body: &str, what: &str) -> String {
        format!("{}/out/{}/{what}", self.base, chunk(body))
    }

    /// What is told of the squeezes of a pair of tines.
    pub fn out_squeeze(&self, pair: &str) -> String {
        format!("{}/out/squeeze/{}", self.base, chunk(pair))
    }

    /// What is told of a zone of the bed.
    pub fn out_zone(&self, zone: &str) -> String {
        format!("{}/out/zone/{}", self.base, chunk(zone))
    }
}

/// A name as a part of a key: what has a meaning in keys becomes `_`.
pub(crate) fn chunk(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let chunk: String = name.chars().map(plain).collect();
    if chunk.is_empty() { "_".into() } else { chunk }
}

/// The last part of a key.
pub(crate) fn last(key: &str) -> &str {
    key.rsplit('/').next().unwrap_or(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_be_patterns_are_refused() {
        for bad in ["", "site", "/id", "site/", "a/b/c", "a/*", "a/$x", "a b/c", "ä/b", "a/?"] {
            let told = Keys::of(bad).unwrap_err().to_string();
            assert!(told.contains("SITE/ID") && told.contains(bad), "{told}");
        }
        let keys = Keys::of("yard/ballast-1").unwrap();
        assert_eq!(keys.control("advance"), "ballast/1/yard/ballast-1/ctl/advance");
        assert_eq!(
            keys.out_body("tine 1/a*", "pose"),
            "ballast/1/yard/ballast-1/out/tine_1_a_/pose"
        );
    }
}

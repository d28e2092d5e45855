//! Answers to requests that carry a number: the same request again gets the same answer, and its effect
//! once. (A window is known by its content.)

use super::answer::Answer;
use super::gate::Pass;
use ballast_protocol::lockstep::{RequestError, RequestKind};
use std::collections::VecDeque;
use zenoh::query::Query;

/// How many answers are remembered. A client asks one thing at a time.
const MOST: usize = 16;

/// A request: by whom, by which number, what. All of it must be the same for the same answer.
#[derive(PartialEq)]
pub(super) struct Numbered {
    verb: RequestKind,
    pass: Pass,
    content: Vec<u8>,
}

impl Numbered {
    /// A request that has a number.
    pub fn of(verb: RequestKind, pass: &Pass, query: &Query) -> Option<Self> {
        let content = || query.payload().map_or(Vec::new(), |p| p.to_bytes().into_owned());
        pass.is_known_again(verb).then(|| Self { verb, pass: pass.clone(), content: content() })
    }
}

#[derive(Default)]
pub(super) struct Answered {
    answers: VecDeque<(Numbered, Result<Answer, RequestError>)>,
}

impl Answered {
    pub fn find(&self, asked: Option<&Numbered>) -> Option<Result<Answer, RequestError>> {
        let asked = asked?;
        let known = self.answers.iter().find(|(known, _)| known == asked);
        known.map(|(_, answer)| answer.clone())
    }

    pub fn keep(&mut self, asked: Option<Numbered>, answer: &Result<Answer, RequestError>) {
        let Some(asked) = asked else { return };
        if matches!(asked.verb, RequestKind::Attach | RequestKind::Detach) && answer.is_ok() {
            self.forget();
        }
        // Who has left is refused at the door, and who does not drive takes no place.
        if asked.verb == RequestKind::Detach || asked.verb == RequestKind::Attach && answer.is_err()
        {
            return;
        }
        if self.answers.len() >= MOST {
            self.answers.pop_front();
        }
        self.answers.push_back((asked, answer.clone()));
    }

    /// What was answered to an owner that is gone, or before there was this one, holds no longer.
    pub fn forget(&mut self) {
        self.answers.clear();
    }
}

//! Answers to requests that carry a number: the same request again gets the same answer, and its effect
//! once. (A window is known by its content.)

use super::answer::Answer;
use ballast_protocol::lockstep::Fault;
use std::collections::VecDeque;

/// How many answers are remembered. A client asks one thing at a time.
const MOST: usize = 16;

#[derive(Default)]
pub(super) struct Answered {
    by_number: VecDeque<(String, Result<Answer, Fault>)>,
}

impl Answered {
    pub fn find(&self, number: &str) -> Option<Result<Answer, Fault>> {
        let known = self.by_number.iter().find(|(n, _)| !number.is_empty() && n == number);
        known.map(|(_, answer)| answer.clone())
    }

    pub fn keep(&mut self, number: &str, answer: &Result<Answer, Fault>) {
        if number.is_empty() {
            return;
        }
        if self.by_number.len() >= MOST {
            self.by_number.pop_front();
        }
        self.by_number.push_back((number.into(), answer.clone()));
    }

    /// What was answered to an owner that is gone holds no longer.
    pub fn forget(&mut self) {
        self.by_number.clear();
    }
}

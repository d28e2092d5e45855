//! Whether it is worth while to list what may matter in the steps to come.
//!
//! Bodies that move fast against each other wear out a list before its first use; then it is cheaper to find only what
//! matters now. Nothing here changes a result.

/// What became of a pair's lists.
#[derive(Debug, Clone, Copy, Default)]
pub struct Worth {
    /// Whether the list that was last wanted has never been used; it may not have come about.
    unused: bool,
    /// How many in a row were never used, at most [`MOST`].
    in_vain: u8,
    /// How often to do without before the next trial.
    pause: u8,
}

/// With each list that was made in vain pauses double, up to this many times.
const MOST: u8 = 4;

impl Worth {
    /// The list served.
    pub fn used(&mut self) {
        *self = Self::default();
    }

    /// The list that there was, if any, does not hold any more; whether to make another.
    pub fn ask(&mut self) -> bool {
        if std::mem::take(&mut self.unused) {
            self.in_vain = MOST.min(self.in_vain + 1);
            self.pause = 1 << self.in_vain;
        }
        self.unused = self.pause <= 1;
        self.pause = self.pause.saturating_sub(1);
        self.unused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which of so many steps make a list, if those at the given steps would be used in the next one.
    fn steps_that_make(count: usize, serves: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut worth = Worth::default();
        let mut list = None;
        let mut made = Vec::new();
        for step in 0..count {
            if list.is_some_and(&serves) {
                worth.used();
                continue;
            }
            list = None;
            if worth.ask() {
                list = Some(step);
                made.push(step);
            }
        }
        made
    }

    #[test]
    fn lists_that_are_never_used_are_tried_ever_less_often() {
        assert_eq!(steps_that_make(60, |_| false), [0, 2, 6, 14, 30, 46]);
    }

    #[test]
    fn a_list_that_serves_is_kept_and_a_slow_pair_makes_lists_at_once() {
        assert_eq!(steps_that_make(60, |_| true), [0]);
        assert_eq!(steps_that_make(60, |made| made >= 6), [0, 2, 6]);
    }
}

//! Lists of numbers in one array.

/// Lists of numbers in one array: list `i` is `items[starts[i]..starts[i + 1]]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lists {
    /// Start of each list in `items`, and the end of the last one.
    pub starts: Vec<u32>,
    /// Items of all lists.
    pub items: Vec<u32>,
}

impl Lists {
    /// Returns the number of lists.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// True if there is no list.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns list `i`.
    pub fn list(&self, i: usize) -> &[u32] {
        &self.items[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Groups the items `0..keys.len()` by their keys, which are below `lists`. Stable, so every list is ascending.
    pub(super) fn fill(&mut self, lists: usize, keys: impl Iterator<Item = u32> + Clone) {
        self.group_by_key(lists, keys.zip(0..));
    }

    /// Removes all lists.
    pub(super) fn clear(&mut self) {
        self.starts.clear();
        self.starts.push(0);
        self.items.clear();
    }

    /// Appends a list.
    pub(super) fn push_list(&mut self, list: &[u32]) {
        self.items.extend_from_slice(list);
        self.starts.push(self.items.len() as u32);
    }

    /// Groups items by their keys, which are below `lists`, in their order.
    pub(super) fn group_by_key(
        &mut self,
        lists: usize,
        entries: impl Iterator<Item = (u32, u32)> + Clone,
    ) {
        self.starts.clear();
        self.starts.resize(lists + 1, 0);
        for (key, _) in entries.clone() {
            self.starts[key as usize + 1] += 1;
        }
        for i in 0..lists {
            self.starts[i + 1] += self.starts[i];
        }
        self.items.clear();
        self.items.resize(self.starts[lists] as usize, 0);
        let mut next = self.starts.clone();
        for (key, item) in entries {
            let place = &mut next[key as usize];
            self.items[*place as usize] = item;
            *place += 1;
        }
    }
}

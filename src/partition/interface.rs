//! Interface: contacts between subdomains, grouped by pair and coloured.

use super::lists::Lists;

/// Contacts between grains of different subdomains.
///
/// A group contains the contacts of one pair of subdomains. Groups of one colour share no subdomain, hence no grain:
/// the order of colours exposes the most parallelism.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Interface {
    /// The two subdomains of each group, ascending.
    pub pairs: Vec<[u32; 2]>,
    /// Contacts of each group, ascending.
    pub contacts: Lists,
    /// Groups of each colour, ascending.
    pub colours: Lists,
    /// Groups of each subdomain, in the order of their colours.
    pub groups_by_subdomain: Lists,
}

impl Interface {
    /// Groups `contacts`, given by the owners of their grains, ascending.
    pub(crate) fn group(&mut self, subdomains: usize, contacts: &[([u32; 2], u32)]) {
        self.pairs.clear();
        self.contacts.starts.clear();
        self.contacts.items.clear();
        for &(pair, contact) in contacts {
            if self.pairs.last() != Some(&pair) {
                self.pairs.push(pair);
                self.contacts.starts.push(self.contacts.items.len() as u32);
            }
            self.contacts.items.push(contact);
        }
        self.contacts.starts.push(self.contacts.items.len() as u32);
        self.colour(subdomains);
    }

    /// Colours the graph of subdomains greedily, largest groups first so that groups of a colour have similar sizes.
    fn colour(&mut self, subdomains: usize) {
        let mut order: Vec<usize> = (0..self.pairs.len()).collect();
        order.sort_by_key(|&g| std::cmp::Reverse(self.contacts.list(g).len()));
        let mut taken: Vec<Vec<bool>> = vec![Vec::new(); subdomains];
        let mut colour = vec![0u32; self.pairs.len()];
        let mut colours = 0;
        for g in order {
            let [a, b] = self.pairs[g].map(|s| s as usize);
            let used = |s: usize, c: usize| taken[s].get(c).copied().unwrap_or(false);
            let free = (0..).find(|&c| !used(a, c) && !used(b, c)).unwrap_or(0);
            for s in [a, b] {
                if taken[s].len() <= free {
                    taken[s].resize(free + 1, false);
                }
                taken[s][free] = true;
            }
            colour[g] = free as u32;
            colours = colours.max(free + 1);
        }
        self.colours.fill(colours, colour.iter().copied());
        let Self { pairs, colours, groups_by_subdomain, .. } = self;
        let sides = |&g: &u32| pairs[g as usize].map(|s| (s, g));
        groups_by_subdomain.group_by_key(subdomains, colours.items.iter().flat_map(sides));
    }
}

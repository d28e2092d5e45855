//! Short lists of features by number, without memory of their own.

/// At most `N` numbers below 256, or the note that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct Few<const N: usize> {
    /// Above N: too many.
    count: u8,
    items: [u8; N],
}

impl<const N: usize> Default for Few<N> {
    fn default() -> Self {
        Self { count: 0, items: [0; N] }
    }
}

impl<const N: usize> Few<N> {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The note alone.
    pub fn too_many() -> Self {
        Self { count: u8::MAX, items: [0; N] }
    }

    /// Notes that there are more than the list can hold.
    pub fn overflow(&mut self) {
        self.count = u8::MAX;
    }

    pub fn push(&mut self, item: usize) {
        match u8::try_from(item) {
            Ok(item) if usize::from(self.count) < N => {
                self.items[usize::from(self.count)] = item;
                self.count += 1;
            }
            _ => self.overflow(),
        }
    }

    /// The `k`-th.
    #[inline]
    pub fn item(&self, k: usize) -> usize {
        usize::from(self.items[k])
    }

    /// How many items are here.
    pub fn len(&self) -> usize {
        usize::from(self.count).min(N)
    }

    /// Where an item is, which is pushed if it is new; any place if there are too many.
    pub fn place_of(&mut self, item: usize) -> usize {
        let known = self.iter().position(|i| i == item);
        known.unwrap_or_else(|| {
            self.push(item);
            self.len() - 1
        })
    }

    /// What was pushed, in order, and the first of it over and over; of nothing, zeros.
    pub fn filled(mut self) -> [u8; N] {
        let (first, count) = (self.items[0], self.len());
        self.items[count..].fill(first);
        self.items
    }

    /// Whether all that were pushed are here.
    pub fn is_whole(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// What was pushed, in order; of a list that is not whole, some.
    pub fn iter(&self) -> impl Iterator<Item = usize> + Clone {
        self.items.iter().take(usize::from(self.count)).map(|i| usize::from(*i))
    }
}

/// At most `N` pairs of numbers below 256, those of the largest bound first, or the note that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct Ranked<const N: usize> {
    /// Above N: too many.
    count: u8,
    items: [[u8; 2]; N],
    bounds: [f32; N],
}

impl<const N: usize> Default for Ranked<N> {
    fn default() -> Self {
        Self { count: 0, items: [[0; 2]; N], bounds: [0.0; N] }
    }
}

impl<const N: usize> Ranked<N> {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    pub fn push(&mut self, item: [usize; 2], bound: f64) {
        let count = usize::from(self.count);
        let ([Ok(a), Ok(b)], true) = (item.map(u8::try_from), count < N) else {
            self.count = u8::MAX;
            return;
        };
        let bound = bound as f32;
        let place = self.bounds[..count].partition_point(|b| *b >= bound);
        self.items.copy_within(place..count, place + 1);
        self.bounds.copy_within(place..count, place + 1);
        (self.items[place], self.bounds[place]) = ([a, b], bound);
        self.count += 1;
    }

    /// Whether all that were pushed are here.
    pub fn is_whole(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// What was pushed and its bound, to single precision; of a list that is not whole, some.
    pub fn iter(&self) -> impl Iterator<Item = ([usize; 2], f64)> {
        let bounds = self.bounds.iter().map(|b| f64::from(*b));
        let items = self.items.iter().map(|item| item.map(usize::from));
        items.zip(bounds).take(usize::from(self.count))
    }
}

//! Lanes that count their operations, to measure the arithmetic of a visit.
//!
//! The count belongs to the thread. No result depends on it.

use crate::lanes::{BodyVelocity, LANES, Lanes, Portable};
use std::cell::Cell;
use std::ops::AddAssign;

/// Numbers of operations on rows of eight f64; comparisons, selections and conversions are not counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OperationCounts {
    /// Additions, subtractions and multiplications.
    pub plain: u64,
    /// Fused multiply-adds.
    pub fused: u64,
    /// Divisions and square roots.
    pub divisions: u64,
}

impl AddAssign for OperationCounts {
    fn add_assign(&mut self, other: Self) {
        self.plain += other.plain;
        self.fused += other.fused;
        self.divisions += other.divisions;
    }
}

impl OperationCounts {
    /// Number of operations on single f64: a fused one counts as two, a division or root as one.
    pub fn flops(&self) -> u64 {
        LANES as u64 * (self.plain + 2 * self.fused + self.divisions)
    }
}

thread_local! {
    static COUNTS: Cell<OperationCounts> = const { Cell::new(OperationCounts { plain: 0, fused: 0, divisions: 0 }) };
}

/// Counts the operations of `work` on this thread with [`CountingLanes`].
pub fn count_operations(work: impl FnOnce()) -> OperationCounts {
    COUNTS.set(OperationCounts::default());
    work();
    COUNTS.get()
}

/// Portable lanes whose arithmetic is counted.
#[derive(Clone, Copy)]
pub struct CountingLanes(Portable);

fn plain(result: Portable) -> CountingLanes {
    COUNTS.set(OperationCounts { plain: COUNTS.get().plain + 1, ..COUNTS.get() });
    CountingLanes(result)
}

fn fused(result: Portable) -> CountingLanes {
    COUNTS.set(OperationCounts { fused: COUNTS.get().fused + 1, ..COUNTS.get() });
    CountingLanes(result)
}

fn divided(result: Portable) -> CountingLanes {
    COUNTS.set(OperationCounts { divisions: COUNTS.get().divisions + 1, ..COUNTS.get() });
    CountingLanes(result)
}

impl Lanes for CountingLanes {
    type Mask = <Portable as Lanes>::Mask;

    fn splat(x: f64) -> Self {
        Self(Portable::splat(x))
    }
    fn load(row: &[f64; LANES]) -> Self {
        Self(Portable::load(row))
    }
    fn load32(row: &[f32; LANES]) -> Self {
        Self(Portable::load32(row))
    }
    fn store(self, row: &mut [f64; LANES]) {
        self.0.store(row);
    }
    fn store32(self, row: &mut [f32; LANES]) {
        self.0.store32(row);
    }
    fn add(self, other: Self) -> Self {
        plain(self.0.add(other.0))
    }
    fn sub(self, other: Self) -> Self {
        plain(self.0.sub(other.0))
    }
    fn mul(self, other: Self) -> Self {
        plain(self.0.mul(other.0))
    }
    fn div(self, other: Self) -> Self {
        divided(self.0.div(other.0))
    }
    fn sqrt(self) -> Self {
        divided(self.0.sqrt())
    }
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    fn mul_add(self, b: Self, c: Self) -> Self {
        fused(self.0.mul_add(b.0, c.0))
    }
    fn mul_sub(self, b: Self, c: Self) -> Self {
        fused(self.0.mul_sub(b.0, c.0))
    }
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        fused(self.0.neg_mul_add(b.0, c.0))
    }
    fn lt(self, other: Self) -> Self::Mask {
        self.0.lt(other.0)
    }
    fn le(self, other: Self) -> Self::Mask {
        self.0.le(other.0)
    }
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Portable::and(a, b)
    }
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Portable::or(a, b)
    }
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Portable::and_not(a, b)
    }
    fn any(mask: Self::Mask) -> bool {
        Portable::any(mask)
    }
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(Portable::select(mask, yes.0, no.0))
    }
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8] {
        // SAFETY: the caller's.
        unsafe { Portable::gather(lines, indices) }.map(Self)
    }
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]) {
        // SAFETY: the caller's.
        unsafe { Portable::scatter(rows.map(|row| row.0), lines, indices) };
    }
}

#[cfg(test)]
mod tests {
    use crate::nlgs::ContactSet;
    use crate::nlgs::lattice_scene::LatticeScene;

    #[test]
    fn a_visit_is_some_hundred_operations_and_counting_changes_nothing() {
        let scene = LatticeScene::grid([5, 4, 3], 2, 0.0, 3);
        let problem = &scene.problem;
        let contacts: Vec<u32> = (0..problem.contacts.len() as u32).collect();
        let mut set = ContactSet::default();
        set.pack(problem, &contacts, problem.body_count(), |grain| grain);
        set.lines[..problem.body_count()].copy_from_slice(&problem.lines);
        set.apply_impulses();
        let mut twin = set.clone();
        let operations = set.operations(1.0);
        set.sweep(1.0);
        twin.sweep(1.0);
        assert_eq!(set.lines, twin.lines);
        let (flops, lanes) =
            (operations.flops() as f64, set.contact_count() as f64 / set.fill_ratio());
        assert!((150.0..1000.0).contains(&(flops / lanes)), "{} per lane", flops / lanes);
        assert!(
            operations.fused > operations.plain / 2 && operations.divisions > 0,
            "{operations:?}"
        );
        let traffic = set.traffic();
        let blocks = traffic.footprint as f64 - 64.0 * set.lines.len() as f64;
        assert!((152.0..=176.0).contains(&(blocks / lanes)), "{traffic:?}");
        assert!(
            traffic.streamed > traffic.footprint && traffic.core > traffic.footprint,
            "{traffic:?}"
        );
    }
}

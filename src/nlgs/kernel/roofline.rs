//! Peak throughput of an [`InstructionSet`]: work whose rate bounds that of sweeps. The caller measures the time.

use crate::lanes::{BodyVelocity, InstructionSet, LANES, Lanes, VelocityKernel, run};

/// Number of f64 per line of the triad.
const ROW: usize = size_of::<BodyVelocity>() / size_of::<f64>();

impl InstructionSet {
    /// Bytes that [`InstructionSet::triad`] moves per line: two reads and a write in place.
    pub const TRIAD_BYTES: usize = 3 * size_of::<BodyVelocity>();

    /// Computes `a = b + factor a` on lines of eight f64, at the peak rate of memory or cache.
    pub fn triad(self, a: &mut [BodyVelocity], b: &[BodyVelocity], factor: f64) {
        // SAFETY: the pass has no indices.
        unsafe { run(self, TriadPass { a, b, factor }) }
    }

    /// Number of f64 operations in a round of [`InstructionSet::multiply_adds`] or [`InstructionSet::divisions`].
    pub fn operations_per_round(self) -> usize {
        LANES * if self.has_32_registers() { MANY_CHAINS } else { FEW_CHAINS }
    }

    /// Computes `rounds` of `x = x factor + c` in independent chains, at the peak rate of fused operations; returns the sum.
    pub fn multiply_adds(self, rounds: u64, factor: f64) -> f64 {
        // SAFETY: the passes have no indices.
        match self.has_32_registers() {
            true => unsafe { run(self, MultiplyAddPass::<MANY_CHAINS> { rounds, factor }) },
            false => unsafe { run(self, MultiplyAddPass::<FEW_CHAINS> { rounds, factor }) },
        }
    }

    /// Computes `rounds` of `x = c / x` in independent chains, at the peak rate of divisions; returns the sum.
    pub fn divisions(self, rounds: u64, dividend: f64) -> f64 {
        // SAFETY: the passes have no indices.
        match self.has_32_registers() {
            true => unsafe { run(self, DivisionPass::<MANY_CHAINS> { rounds, dividend }) },
            false => unsafe { run(self, DivisionPass::<FEW_CHAINS> { rounds, dividend }) },
        }
    }
}

/// Number of independent chains with 32 registers: enough to hide latency, few enough for the registers.
const MANY_CHAINS: usize = 12;
/// Number of independent chains with 16 registers.
const FEW_CHAINS: usize = 6;

struct TriadPass<'a> {
    a: &'a mut [BodyVelocity],
    b: &'a [BodyVelocity],
    factor: f64,
}

impl VelocityKernel for TriadPass<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        const { assert!(ROW == LANES) };
        let factor = L::splat(self.factor);
        for (a, b) in self.a.iter_mut().zip(self.b) {
            L::load(&a.0).mul_add(factor, L::load(&b.0)).store(&mut a.0);
        }
    }
}

/// Sums the chains, so that the compiler can drop none.
#[inline(always)]
fn sum<L: Lanes, const N: usize>(chains: [L; N]) -> f64 {
    let mut total = 0.0;
    for lanes in chains {
        let mut row = [0.0; LANES];
        lanes.store(&mut row);
        total += row.iter().sum::<f64>();
    }
    total
}

/// Returns chains with different start values.
#[inline(always)]
fn start<L: Lanes, const N: usize>() -> [L; N] {
    let mut chains = [L::splat(1.0); N];
    for k in 0..N {
        chains[k] = L::splat(1.0 + k as f64 * 1e-3);
    }
    chains
}

struct MultiplyAddPass<const N: usize> {
    rounds: u64,
    factor: f64,
}

impl<const N: usize> VelocityKernel for MultiplyAddPass<N> {
    type Output = f64;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> f64 {
        let (factor, plus) = (L::splat(self.factor), L::splat(1.0 - self.factor));
        let mut chains = start::<L, N>();
        for _ in 0..self.rounds {
            for k in 0..N {
                chains[k] = chains[k].mul_add(factor, plus);
            }
        }
        sum(chains)
    }
}

struct DivisionPass<const N: usize> {
    rounds: u64,
    dividend: f64,
}

impl<const N: usize> VelocityKernel for DivisionPass<N> {
    type Output = f64;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> f64 {
        let dividend = L::splat(self.dividend);
        let mut chains = start::<L, N>();
        for _ in 0..self.rounds {
            for k in 0..N {
                chains[k] = dividend.div(chains[k]);
            }
        }
        sum(chains)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_arithmetic_does_the_work_that_is_counted() {
        for arithmetic in InstructionSet::available() {
            let mut a = vec![BodyVelocity([2.0; 8]); 5];
            let b = vec![BodyVelocity([1.0; 8]); 5];
            arithmetic.triad(&mut a, &b, 0.25);
            assert!(a.iter().all(|line| line.0 == [1.5; 8]), "{arithmetic:?}");
            let per_round = arithmetic.operations_per_round() as f64;
            let chains = per_round / LANES as f64;
            let starts: f64 = per_round + LANES as f64 * 1e-3 * chains * (chains - 1.0) / 2.0;
            assert!((arithmetic.multiply_adds(0, 0.5) - starts).abs() < 1e-9);
            // Fixed point 1 of every chain.
            assert!((arithmetic.multiply_adds(100, 0.5) - per_round).abs() < 1e-9);
            assert!((arithmetic.divisions(2, 3.0) - starts).abs() < 1e-9);
        }
    }
}

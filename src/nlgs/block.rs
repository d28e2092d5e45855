//! Eight contacts side by side, as the kernel reads them.
//!
//! 160 bytes per contact between two grains, 144 per contact with a driven body. Rows are of eight
//! lanes. Lanes without a contact are all zero with a tangent ratio of one, and their grain is the
//! set's spare line: every visit leaves them at zero impulse.

use crate::lanes::LANES;
use crate::local_problem::LocalContact;

/// A row of f32.
pub type Row32 = [f32; LANES];
/// A row of f64.
pub type Row64 = [f64; LANES];

/// What a visit needs to know of the Delassus blocks and of friction.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct LawRows {
    /// `1/W_nn`, kg.
    pub normal_mass: Row32,
    /// `k = W_Tn / W_nn`.
    pub coupling: [Row32; 2],
    /// `1/S_ss`, kg.
    pub tangent_mass: Row32,
    /// `S_ss / S_tt`.
    pub tangent_ratio: Row32,
    /// μ.
    pub friction: Row32,
    /// Where the next slip solve starts: the last one's result.
    pub slip: Row32,
}

/// Eight contacts between grains; no grain occurs twice.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct PairBlock {
    pub normal: [Row32; 3],
    pub tangent: [Row32; 3],
    /// Row `3 k + j`: component `j` of the arm of axis `k`.
    pub candidate_arms: [Row32; 9],
    pub antagonist_arms: [Row32; 9],
    pub law: LawRows,
    /// Gap or restitution, m/s.
    pub offset: Row32,
    /// Impulses (n, t, s), N s.
    pub impulse: [Row64; 3],
    /// Lines of the grains.
    pub candidate: [u32; LANES],
    pub antagonist: [u32; LANES],
}

/// Eight contacts of one grain each with a driven body; no grain occurs twice.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct SingleBlock {
    pub normal: [Row32; 3],
    pub tangent: [Row32; 3],
    pub arms: [Row32; 9],
    pub law: LawRows,
    /// Gap or restitution minus the driven body's velocity (n, t, s), m/s.
    pub offset: [Row64; 3],
    /// Impulses (n, t, s), N s.
    pub impulse: [Row64; 3],
    /// Lines of the grains.
    pub grain: [u32; LANES],
}

/// What iterations with momentum remember of a block (T-37).
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct NncgBlock {
    /// Impulses when the iterations under way began, N s.
    pub before: [Row64; 3],
    /// Sum of the last changes, the older the less, N s.
    pub direction: [Row64; 3],
    /// The root of a third of `tr W_αα`, kg^(-1/2).
    pub weight: Row64,
}

const ZERO32: Row32 = [0.0; LANES];
const ZERO64: Row64 = [0.0; LANES];

impl LawRows {
    /// Eight lanes without contact.
    pub const EMPTY: Self = Self {
        normal_mass: ZERO32,
        coupling: [ZERO32; 2],
        tangent_mass: ZERO32,
        tangent_ratio: [1.0; LANES],
        friction: ZERO32,
        slip: ZERO32,
    };

    /// `tr W_αα` of a lane, 1/kg; zero without a contact.
    pub fn trace(&self, lane: usize) -> f64 {
        if self.normal_mass[lane] == 0.0 {
            return 0.0;
        }
        let [k1, k2] = self.coupling.map(|row| row[lane] as f64);
        let (normal, across) =
            (1.0 / self.normal_mass[lane] as f64, 1.0 / self.tangent_mass[lane] as f64);
        normal * (1.0 + k1 * k1 + k2 * k2) + across * (1.0 + 1.0 / self.tangent_ratio[lane] as f64)
    }

    /// The root of a third of `tr W_αα` of each lane, kg^(-1/2).
    pub fn weight(&self) -> Row64 {
        std::array::from_fn(|lane| (self.trace(lane) / 3.0).sqrt())
    }

    fn set(&mut self, lane: usize, contact: &LocalContact) {
        self.normal_mass[lane] = contact.normal_mass;
        self.coupling[0][lane] = contact.coupling[0];
        self.coupling[1][lane] = contact.coupling[1];
        self.tangent_mass[lane] = contact.tangent_mass;
        self.tangent_ratio[lane] = contact.tangent_ratio;
        self.friction[lane] = contact.friction;
        self.slip[lane] = 1.0;
    }
}

impl PairBlock {
    /// A block of padding; `spare` is the line that padding refers to.
    pub fn empty(spare: u32) -> Self {
        Self {
            normal: [ZERO32; 3],
            tangent: [ZERO32; 3],
            candidate_arms: [ZERO32; 9],
            antagonist_arms: [ZERO32; 9],
            law: LawRows::EMPTY,
            offset: ZERO32,
            impulse: [ZERO64; 3],
            candidate: [spare; LANES],
            antagonist: [spare; LANES],
        }
    }

    /// Puts a contact between the lines `grains` in a lane.
    pub fn set(&mut self, lane: usize, contact: &LocalContact, grains: [u32; 2]) {
        for j in 0..3 {
            self.normal[j][lane] = contact.normal[j];
            self.tangent[j][lane] = contact.tangent[j];
            self.impulse[j][lane] = contact.impulse[j];
            for k in 0..3 {
                self.candidate_arms[3 * k + j][lane] = contact.candidate_arms[k][j];
                self.antagonist_arms[3 * k + j][lane] = contact.antagonist_arms[k][j];
            }
        }
        self.law.set(lane, contact);
        // Rounded to f32 already; between grains there is nothing tangential.
        self.offset[lane] = contact.offset.x as f32;
        self.candidate[lane] = grains[0];
        self.antagonist[lane] = grains[1];
    }
}

impl SingleBlock {
    /// A block of padding; `spare` is the line that padding refers to.
    pub fn empty(spare: u32) -> Self {
        Self {
            normal: [ZERO32; 3],
            tangent: [ZERO32; 3],
            arms: [ZERO32; 9],
            law: LawRows::EMPTY,
            offset: [ZERO64; 3],
            impulse: [ZERO64; 3],
            grain: [spare; LANES],
        }
    }

    /// Puts a contact of the line `grain` with a driven body in a lane.
    pub fn set(&mut self, lane: usize, contact: &LocalContact, grain: u32) {
        for j in 0..3 {
            self.normal[j][lane] = contact.normal[j];
            self.tangent[j][lane] = contact.tangent[j];
            self.offset[j][lane] = contact.offset[j];
            self.impulse[j][lane] = contact.impulse[j];
            for k in 0..3 {
                self.arms[3 * k + j][lane] = contact.candidate_arms[k][j];
            }
        }
        self.law.set(lane, contact);
        self.grain[lane] = grain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nlgs::lattice_scene::LatticeScene;
    use std::mem::offset_of;

    #[test]
    fn blocks_are_as_small_as_documented() {
        assert_eq!(size_of::<PairBlock>(), 160 * LANES);
        assert_eq!(size_of::<SingleBlock>(), 144 * LANES);
    }

    #[test]
    fn traces_are_those_of_the_delassus_blocks() {
        let problem = LatticeScene::grid([2, 2, 2], 2, 0.0, 5).problem;
        for (i, contact) in problem.contacts.iter().enumerate() {
            let mut block = SingleBlock::empty(0);
            block.set(3, contact, 0);
            let expected = contact.law_block().trace();
            assert!((block.law.trace(3) / expected - 1.0).abs() < 1e-6, "{i}: {expected}");
            assert_eq!(block.law.trace(2), 0.0);
        }
    }

    #[test]
    fn a_visit_writes_four_cache_lines_of_its_block() {
        let slip = offset_of!(LawRows, slip);
        for (slip, impulse) in [
            (offset_of!(PairBlock, law) + slip, offset_of!(PairBlock, impulse)),
            (offset_of!(SingleBlock, law) + slip, offset_of!(SingleBlock, impulse)),
        ] {
            assert_eq!(impulse % 64, 0);
            assert_eq!(slip / 64, (slip + size_of::<Row32>() - 1) / 64);
            assert!(slip / 64 < impulse / 64);
        }
    }
}

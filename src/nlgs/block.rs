//! Blocks of eight contacts in the layout of the kernel.
//!
//! 176 bytes per contact between two grains, 152 per contact with a driven body. Rows are of eight
//! lanes. Lanes without a contact are all zero with a tangent ratio of one, and their body is the
//! set's spare line: every visit leaves their impulse at zero.

use crate::lanes::LANES;
use crate::local_problem::LocalContact;

pub use crate::local_problem::rows::{Row32, Row64};

/// Data of the contact laws of a block: Delassus blocks, compliance and friction.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(32))]
pub struct LawRows {
    /// Normal mass `1/W_nn`, kg.
    pub normal_mass: Row32,
    /// Coupling `k = W_Tn / W_nn`.
    pub coupling: [Row32; 2],
    /// Tangential mass `1/S_ss`, kg.
    pub tangent_mass: Row32,
    /// Ratio of the tangential masses `S_ss / S_tt`.
    pub tangent_ratio: Row32,
    /// Friction coefficient μ.
    pub friction: Row32,
    /// Compliance (normal, tangential), 1/kg.
    pub compliance: [Row32; 2],
    /// Initial guess of the next slip solve: the result of the last one.
    pub slip: Row32,
}

/// Block of eight contacts between mobile bodies, none of which occurs twice.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct PairBlock {
    /// Contact normals.
    pub normal: [Row32; 3],
    /// First tangents.
    pub tangent: [Row32; 3],
    /// Arms of the candidates; row `3 k + j` is component `j` of the arm of axis `k`.
    pub candidate_arms: [Row32; 9],
    /// Arms of the antagonists.
    pub antagonist_arms: [Row32; 9],
    /// Contact laws.
    pub law: LawRows,
    /// Offset from gap or restitution and tangential spring (n, t, s), m/s.
    pub offset: [Row32; 3],
    /// Impulses (n, t, s), N s.
    pub impulse: [Row64; 3],
    /// Lines of the candidates.
    pub candidate: [u32; LANES],
    /// Lines of the antagonists.
    pub antagonist: [u32; LANES],
}

/// Block of eight contacts of mobile bodies, none of which occurs twice, with driven bodies.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct SingleBlock {
    /// Contact normals.
    pub normal: [Row32; 3],
    /// First tangents.
    pub tangent: [Row32; 3],
    /// Arms of the mobile bodies; row `3 k + j` is component `j` of the arm of axis `k`.
    pub arms: [Row32; 9],
    /// Contact laws.
    pub law: LawRows,
    /// Offset from gap or restitution and tangential spring minus the driven body's velocity (n, t, s), m/s.
    pub offset: [Row64; 3],
    /// Impulses (n, t, s), N s.
    pub impulse: [Row64; 3],
    /// Lines of the mobile bodies.
    pub grain: [u32; LANES],
}

/// NNCG data of a block (T-37).
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct NncgBlock {
    /// Impulses after the last extrapolation, N s.
    pub before: [Row64; 3],
    /// Search direction: decaying sum of the last changes, N s.
    pub direction: [Row64; 3],
    /// Weight of each lane: square root of a third of `tr W_αα`, kg^(-1/2).
    pub weight: Row64,
}

const ZERO32: Row32 = [0.0; LANES];
const ZERO64: Row64 = [0.0; LANES];

impl LawRows {
    /// Rows of eight lanes without contact.
    pub const EMPTY: Self = Self {
        normal_mass: ZERO32,
        coupling: [ZERO32; 2],
        tangent_mass: ZERO32,
        tangent_ratio: [1.0; LANES],
        friction: ZERO32,
        compliance: [ZERO32; 2],
        slip: ZERO32,
    };

    /// Trace `tr W_αα` of a lane, 1/kg; zero without a contact.
    pub fn trace(&self, lane: usize) -> f64 {
        if self.normal_mass[lane] == 0.0 {
            return 0.0;
        }
        let [k1, k2] = self.coupling.map(|row| row[lane] as f64);
        let (normal, across) =
            (1.0 / self.normal_mass[lane] as f64, 1.0 / self.tangent_mass[lane] as f64);
        normal * (1.0 + k1 * k1 + k2 * k2) + across * (1.0 + 1.0 / self.tangent_ratio[lane] as f64)
    }

    /// Weight of each lane: square root of a third of `tr W_αα`, kg^(-1/2).
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
        self.compliance[0][lane] = contact.compliance[0];
        self.compliance[1][lane] = contact.compliance[1];
        self.slip[lane] = 1.0;
    }
}

impl PairBlock {
    /// Returns a block of padding; `spare` is the line that padding refers to.
    pub fn empty(spare: u32) -> Self {
        Self {
            normal: [ZERO32; 3],
            tangent: [ZERO32; 3],
            candidate_arms: [ZERO32; 9],
            antagonist_arms: [ZERO32; 9],
            law: LawRows::EMPTY,
            offset: [ZERO32; 3],
            impulse: [ZERO64; 3],
            candidate: [spare; LANES],
            antagonist: [spare; LANES],
        }
    }

    /// Sets a lane to a contact between the lines `grains`.
    pub fn set(&mut self, lane: usize, contact: &LocalContact, grains: [u32; 2]) {
        for j in 0..3 {
            self.normal[j][lane] = contact.normal[j];
            self.tangent[j][lane] = contact.tangent[j];
            // Already rounded to f32.
            self.offset[j][lane] = contact.offset[j] as f32;
            self.impulse[j][lane] = contact.impulse[j];
            for k in 0..3 {
                self.candidate_arms[3 * k + j][lane] = contact.candidate_arms[k][j];
                self.antagonist_arms[3 * k + j][lane] = contact.antagonist_arms[k][j];
            }
        }
        self.law.set(lane, contact);
        self.candidate[lane] = grains[0];
        self.antagonist[lane] = grains[1];
    }
}

impl SingleBlock {
    /// Returns a block of padding; `spare` is the line that padding refers to.
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

    /// Sets a lane to a contact of the line `grain` with a driven body.
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
        assert_eq!(size_of::<PairBlock>(), 176 * LANES);
        assert_eq!(size_of::<SingleBlock>(), 152 * LANES);
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

//! Observables of a bed.
//!
//! Reads: model and state, which holds the contacts of the step that led to it; observables of gaps and normals read
//! the workspace of that step. Writes: nothing.
//! Theory: (T-14), (T-21) to (T-26). Cost: O(grains + contacts) each; they run only on request.
//! Contract: measuring never changes a result; sums have a fixed order, so the same state gives the
//! same bytes for any number of threads. The state fits the model, the workspace the state.

pub mod compactness;
pub mod coordination;
pub mod energy;
pub mod grain_size;
pub mod inertial_number;
pub mod lost;
pub mod penetration;
pub mod squeeze;
pub mod stones;
pub mod stress;
mod sum;
pub mod zone;

pub use compactness::{Compactness, compactness};
pub use coordination::{Coordination, coordination};
pub use energy::{energy, mean_speed};
pub use inertial_number::{InertialNumber, inertial_number};
pub use lost::lost_grains;
pub use penetration::{Penetration, penetration};
pub use squeeze::{
    MIN_CONTACT_FORCE, SqueezeMeter, SqueezeOutcome, SqueezePair, SqueezeRecord, SqueezeRule,
    TineStep,
};
pub use stones::{EN_13450_SIEVES, MassWeightedMean, StoneStatistics, stone_statistics};
pub use stress::{Stress, stress};
pub use zone::Zone;

#[cfg(test)]
mod scene;

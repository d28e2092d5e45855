//! Eight numbers at a time, with the instructions that the processor has.
//!
//! Contract: the same bits from every [`InstructionSet`]. LaneKernel is written once, for any [`Lanes`].
//!
//! This room and `nlgs::kernel` are the only ones of the crate with `unsafe`. Here it is sound because types that use
//! instructions beyond the base ones are private and used only inside [`run`], after the processor was asked.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod body_velocity;
mod operations;
mod portable;

pub use body_velocity::BodyVelocity;
pub(crate) use operations::each;
pub use operations::{LANES, Lanes};
pub use portable::Portable;

/// What reads and writes lines by index, written once for all arithmetics.
pub trait VelocityKernel {
    type Output;
    /// # Safety
    /// The indices in what it reads are below the number of lines.
    unsafe fn run<L: Lanes>(self) -> Self::Output;
}

/// What needs no lines.
pub trait LaneKernel {
    type Output;
    fn run<L: Lanes>(self) -> Self::Output;
}

impl<W: LaneKernel> VelocityKernel for W {
    type Output = W::Output;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> W::Output {
        LaneKernel::run::<L>(self)
    }
}

/// Which instructions compute; the bits are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InstructionSet(InstructionKind);

/// Private, so that an [`InstructionSet`] is proof that the processor was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum InstructionKind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// What every processor has.
    pub const PORTABLE: Self = Self(InstructionKind::Portable);

    /// All that there are, the fastest first.
    const ALL: &[Self] = &[
        #[cfg(target_arch = "x86_64")]
        Self(InstructionKind::Avx512),
        #[cfg(target_arch = "x86_64")]
        Self(InstructionKind::Avx2),
        Self::PORTABLE,
    ];

    /// Whether this processor has them.
    fn is_supported(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        let fused = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        match self.0 {
            InstructionKind::Portable => true,
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx2 => fused,
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx512 => fused && is_x86_feature_detected!("avx512f"),
        }
    }

    /// All that this processor has, the fastest first.
    pub fn available() -> Vec<Self> {
        Self::ALL.iter().copied().filter(|one| one.is_supported()).collect()
    }

    /// The fastest one that this processor has.
    pub fn detect() -> Self {
        Self::ALL.iter().copied().find(|one| one.is_supported()).unwrap_or(Self::PORTABLE)
    }

    /// Whether there are 32 registers instead of 16.
    pub fn has_32_registers(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return self.0 == InstructionKind::Avx512;
        #[cfg(not(target_arch = "x86_64"))]
        false
    }

    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self.0 {
            InstructionKind::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx512 => "avx512",
        }
    }
}

/// Runs a pass with these instructions.
///
/// # Safety
/// As for [`VelocityKernel::run`].
pub unsafe fn run<P: VelocityKernel>(arithmetic: InstructionSet, pass: P) -> P::Output {
    // SAFETY: the caller's, and [`InstructionSet::is_supported`] asked the processor.
    unsafe {
        match arithmetic.0 {
            InstructionKind::Portable => pass.run::<Portable>(),
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx2 => run_avx2(pass),
            #[cfg(target_arch = "x86_64")]
            InstructionKind::Avx512 => run_avx512(pass),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
unsafe fn run_avx2<P: VelocityKernel>(pass: P) -> P::Output {
    // SAFETY: the caller's.
    unsafe { pass.run::<avx2::Avx2>() }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn run_avx512<P: VelocityKernel>(pass: P) -> P::Output {
    // What has to lie on a cache line makes the compiler align the stack, and with it the registers that are put there for
    // a while: elsewhere each of them lies on two lines.
    std::hint::black_box(&BodyVelocity::default());
    // SAFETY: the caller's.
    unsafe { pass.run::<avx512::Avx512>() }
}

/// Asks for a value's memory to be brought to the cache.
pub fn prefetch<T: ?Sized>(value: &T) {
    prefetch_at(std::ptr::from_ref(value).cast::<u8>(), size_of_val(value));
}

/// Asks for so many bytes from `place` on to be brought to the cache; the address may be anything.
#[inline(always)]
pub fn prefetch_at(place: *const u8, bytes: usize) {
    #[cfg(target_arch = "x86_64")]
    for offset in (0..bytes).step_by(size_of::<BodyVelocity>()) {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a prefetch reads nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(place.wrapping_add(offset).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (place, bytes);
}

/// Does work with these instructions.
pub fn compute<W: LaneKernel>(arithmetic: InstructionSet, work: W) -> W::Output {
    // SAFETY: work has no indices.
    unsafe { run(arithmetic, work) }
}

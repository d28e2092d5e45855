//! Arithmetic on eight numbers at a time, with the instructions that the processor supports.
//!
//! Contract: the same bits from every [`InstructionSet`]. A kernel is written once, for any [`Lanes`].
//!
//! Only this module and `nlgs::kernel` contain `unsafe`. Here it is sound because types that use instructions beyond
//! the base ones are private and used only inside [`run`], after feature detection.

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

/// Kernel that reads and writes body velocities by index, written once for all instruction sets.
pub trait VelocityKernel {
    /// Result of the kernel.
    type Output;
    /// Runs the kernel.
    ///
    /// # Safety
    /// All body indices of the kernel are below the number of body velocities.
    unsafe fn run<L: Lanes>(self) -> Self::Output;
}

/// Kernel without body velocities.
pub trait LaneKernel {
    /// Result of the kernel.
    type Output;
    /// Runs the kernel.
    fn run<L: Lanes>(self) -> Self::Output;
}

impl<W: LaneKernel> VelocityKernel for W {
    type Output = W::Output;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> W::Output {
        LaneKernel::run::<L>(self)
    }
}

/// Instruction set that computes; results are the same bits for all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InstructionSet(InstructionKind);

/// Kind of instruction set. Private, so that an [`InstructionSet`] proves that the processor supports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum InstructionKind {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// Instructions that every processor supports.
    pub const PORTABLE: Self = Self(InstructionKind::Portable);

    /// Every instruction set, the fastest first.
    const ALL: &[Self] = &[
        #[cfg(target_arch = "x86_64")]
        Self(InstructionKind::Avx512),
        #[cfg(target_arch = "x86_64")]
        Self(InstructionKind::Avx2),
        Self::PORTABLE,
    ];

    /// True if this processor supports the instructions.
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

    /// Returns all instruction sets of this processor, the fastest first.
    pub fn available() -> Vec<Self> {
        Self::ALL.iter().copied().filter(|one| one.is_supported()).collect()
    }

    /// Returns the fastest instruction set of this processor.
    pub fn detect() -> Self {
        Self::ALL.iter().copied().find(|one| one.is_supported()).unwrap_or(Self::PORTABLE)
    }

    /// True if there are 32 registers instead of 16.
    pub fn has_32_registers(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        return self.0 == InstructionKind::Avx512;
        #[cfg(not(target_arch = "x86_64"))]
        false
    }

    /// Returns the name in tables.
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

/// Runs a kernel with these instructions.
///
/// # Safety
/// See [`VelocityKernel::run`].
pub unsafe fn run<P: VelocityKernel>(arithmetic: InstructionSet, pass: P) -> P::Output {
    // SAFETY: by the caller's contract, and [`InstructionSet::is_supported`] has tested the processor.
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
    // SAFETY: by the caller's contract.
    unsafe { pass.run::<avx2::Avx2>() }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx2,fma")]
unsafe fn run_avx512<P: VelocityKernel>(pass: P) -> P::Output {
    // A value that is aligned to a cache line makes the compiler align the stack, and with it spilled registers,
    // which would otherwise straddle two lines.
    std::hint::black_box(&BodyVelocity::default());
    // SAFETY: by the caller's contract.
    unsafe { pass.run::<avx512::Avx512>() }
}

/// Prefetches a value's memory to the cache.
pub fn prefetch<T: ?Sized>(value: &T) {
    prefetch_at(std::ptr::from_ref(value).cast::<u8>(), size_of_val(value));
}

/// Prefetches `bytes` bytes from `place` on to the cache; the address may be invalid.
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

/// Runs a kernel without body velocities.
pub fn compute<W: LaneKernel>(arithmetic: InstructionSet, work: W) -> W::Output {
    // SAFETY: the kernel has no indices.
    unsafe { run(arithmetic, work) }
}

//! Coupling of a block of contacts with its bodies: `u = Hᵀ V + C r + c` and `V += M⁻¹ H Δr`.

use crate::lanes::{BodyVelocity, Lanes, each};
use crate::nlgs::block::{LawRows, PairBlock, Row64, SingleBlock};

/// Block of eight contacts of one kind with its coupling to the bodies.
pub trait ContactBlock {
    /// Velocities of the bodies, and axes computed on reading them.
    type Gathered<L: Lanes>;

    /// Returns the contact laws.
    fn law(&self) -> &LawRows;
    /// Returns the impulses (n, t, s), N s.
    fn impulse(&self) -> &[Row64; 3];
    /// Returns the data that a visit writes: impulses and slip.
    fn result_mut(&mut self) -> (&mut [Row64; 3], &mut [f32; 8]);
    /// Gathers the velocities of the bodies; also returns the relative velocities `u`.
    ///
    /// # Safety
    /// The indices in the block are below the number of lines.
    unsafe fn read<L: Lanes>(&self, lines: &[BodyVelocity]) -> (Self::Gathered<L>, [L; 3]);
    /// Adds the effect of the impulses `delta` to the velocities, and scatters them.
    ///
    /// # Safety
    /// The indices in the block are below the number of lines.
    unsafe fn push<L: Lanes>(
        &self,
        gathered: Self::Gathered<L>,
        delta: &[L; 3],
        lines: &mut [BodyVelocity],
    );
}

/// Contact axes n, t, s of eight contacts.
pub type Axes<L> = [[L; 3]; 3];

#[inline(always)]
fn load_axes<L: Lanes>(normal: &[[f32; 8]; 3], tangent: &[[f32; 8]; 3]) -> Axes<L> {
    let n = each!(J in 3 => L::load32(&normal[J]));
    let t = each!(J in 3 => L::load32(&tangent[J]));
    // Products of two f32 are exact: rounded once, like the plain cross product.
    [n, t, [cross(&n, &t, 1, 2), cross(&n, &t, 2, 0), cross(&n, &t, 0, 1)]]
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3], i: usize, j: usize) -> L {
    a[i].mul_sub(b[j], a[j].mul(b[i]))
}

#[inline(always)]
pub fn dot<L: Lanes>(a: &[L; 3], b: [L; 3], plus: L) -> L {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0].mul_add(b[0], plus)))
}

/// Returns component `k` of the offset and of the yielding of the springs under the impulses: `C r + c`.
#[inline(always)]
fn spring_velocity<L: Lanes>(law: &LawRows, impulse: &[Row64; 3], k: usize, offset: L) -> L {
    L::load32(&law.compliance[k.min(1)]).mul_add(L::load(&impulse[k]), offset)
}

#[inline(always)]
fn arm_dot<L: Lanes>(arms: &[[f32; 8]; 9], axis: usize, line: &[L; 8], plus: L) -> L {
    let arm = each!(J in 3 => L::load32(&arms[3 * axis + J]));
    dot(&arm, [line[3], line[4], line[5]], plus)
}

/// Component `j` of the whitened angular velocity plus the effect of the impulses `delta`.
#[inline(always)]
fn add_rotation<L: Lanes>(arms: &[[f32; 8]; 9], j: usize, delta: &[L; 3], plus: L) -> L {
    let axis = each!(K in 3 => L::load32(&arms[3 * K + j]));
    dot(&axis, *delta, plus)
}

/// Component `j` of the whitened angular velocity minus the effect of the impulses `delta`.
#[inline(always)]
fn subtract_rotation<L: Lanes>(arms: &[[f32; 8]; 9], j: usize, delta: &[L; 3], from: L) -> L {
    let axis = each!(K in 3 => L::load32(&arms[3 * K + j]));
    let [a, b, c] = axis;
    c.neg_mul_add(delta[2], b.neg_mul_add(delta[1], a.neg_mul_add(delta[0], from)))
}

/// Component `j` of the world impulse.
#[inline(always)]
fn world_component<L: Lanes>(axes: &Axes<L>, j: usize, delta: &[L; 3]) -> L {
    axes[2][j].mul_add(delta[2], axes[1][j].mul_add(delta[1], axes[0][j].mul(delta[0])))
}

impl ContactBlock for PairBlock {
    type Gathered<L: Lanes> = (Axes<L>, [L; 8], [L; 8]);

    #[inline(always)]
    fn law(&self) -> &LawRows {
        &self.law
    }
    #[inline(always)]
    fn impulse(&self) -> &[Row64; 3] {
        &self.impulse
    }
    #[inline(always)]
    fn result_mut(&mut self) -> (&mut [Row64; 3], &mut [f32; 8]) {
        (&mut self.impulse, &mut self.law.slip)
    }
    #[inline(always)]
    unsafe fn read<L: Lanes>(&self, lines: &[BodyVelocity]) -> (Self::Gathered<L>, [L; 3]) {
        // SAFETY: the caller's.
        let (c, a): ([L; 8], [L; 8]) =
            unsafe { (L::gather(lines, &self.candidate), L::gather(lines, &self.antagonist)) };
        let axes = load_axes(&self.normal, &self.tangent);
        let relative = each!(J in 3 => c[J].sub(a[J]));
        let u = each!(K in 3 => {
            let offset = L::load32(&self.offset[K]);
            let spring = spring_velocity(&self.law, &self.impulse, K, offset);
            let of_centres = dot(&axes[K], relative, spring);
            let of_candidate = arm_dot(&self.candidate_arms, K, &c, of_centres);
            of_candidate.sub(arm_dot(&self.antagonist_arms, K, &a, L::splat(0.0)))
        });
        ((axes, c, a), u)
    }
    #[inline(always)]
    unsafe fn push<L: Lanes>(
        &self,
        gathered: Self::Gathered<L>,
        delta: &[L; 3],
        lines: &mut [BodyVelocity],
    ) {
        let (axes, mut c, mut a) = gathered;
        for j in 0..3 {
            let f = world_component(&axes, j, delta);
            c[j] = f.mul_add(c[6], c[j]);
            a[j] = f.neg_mul_add(a[6], a[j]);
            c[3 + j] = add_rotation(&self.candidate_arms, j, delta, c[3 + j]);
            a[3 + j] = subtract_rotation(&self.antagonist_arms, j, delta, a[3 + j]);
        }
        // SAFETY: the caller's.
        unsafe {
            L::scatter(c, lines, &self.candidate);
            L::scatter(a, lines, &self.antagonist);
        }
    }
}

impl ContactBlock for SingleBlock {
    type Gathered<L: Lanes> = (Axes<L>, [L; 8]);

    #[inline(always)]
    fn law(&self) -> &LawRows {
        &self.law
    }
    #[inline(always)]
    fn impulse(&self) -> &[Row64; 3] {
        &self.impulse
    }
    #[inline(always)]
    fn result_mut(&mut self) -> (&mut [Row64; 3], &mut [f32; 8]) {
        (&mut self.impulse, &mut self.law.slip)
    }
    #[inline(always)]
    unsafe fn read<L: Lanes>(&self, lines: &[BodyVelocity]) -> (Self::Gathered<L>, [L; 3]) {
        // SAFETY: the caller's.
        let line: [L; 8] = unsafe { L::gather(lines, &self.grain) };
        let axes = load_axes(&self.normal, &self.tangent);
        let u = each!(K in 3 => {
            let offset = L::load(&self.offset[K]);
            let spring = spring_velocity(&self.law, &self.impulse, K, offset);
            let of_centre = dot(&axes[K], [line[0], line[1], line[2]], spring);
            arm_dot(&self.arms, K, &line, of_centre)
        });
        ((axes, line), u)
    }
    #[inline(always)]
    unsafe fn push<L: Lanes>(
        &self,
        gathered: Self::Gathered<L>,
        delta: &[L; 3],
        lines: &mut [BodyVelocity],
    ) {
        let (axes, mut line) = gathered;
        for j in 0..3 {
            line[j] = world_component(&axes, j, delta).mul_add(line[6], line[j]);
            line[3 + j] = add_rotation(&self.arms, j, delta, line[3 + j]);
        }
        // SAFETY: the caller's.
        unsafe { L::scatter(line, lines, &self.grain) };
    }
}

//! Motion laws of the machine, on the unit interval.
//!
//! A jump of velocity would be an infinite force on the ballast, so all laws start and end at rest.

/// Share of a travel that is spent on speeding up, and again on slowing down.
pub const RAMP: f64 = 0.2;

/// Vibration periods over which an amplitude grows, and dies away again.
const FADE_PERIODS: f64 = 3.0;

/// Peak over mean speed of [`smooth_step`].
pub const SMOOTH_STEP_PEAK: f64 = 1.875;
/// Peak over mean speed of [`travel`].
pub const TRAVEL_PEAK: f64 = 1.0 / (1.0 - RAMP);

/// Minimum-jerk step from 0 to 1; speed and acceleration vanish at both ends.
pub fn smooth_step(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

/// Travel from 0 to 1 at constant rate [`TRAVEL_PEAK`] between two smooth ramps.
///
/// Slower at its peak than a minimum-jerk step (1.25 instead of 1.875): tines enter the bed at
/// about 1 m/s at most. The acceleration is continuous.
pub fn travel(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    if u > 0.5 {
        return 1.0 - travel(1.0 - u);
    }
    if u >= RAMP {
        return TRAVEL_PEAK * (u - 0.5 * RAMP);
    }
    let x = u / RAMP;
    TRAVEL_PEAK * RAMP * x * x * x * (1.0 - 0.5 * x)
}

/// [`smooth_step`] from `start` on, `duration` long; at once where the duration is 0.
pub fn ramp(t: f64, start: f64, duration: f64) -> f64 {
    if duration > 0.0 {
        smooth_step((t - start) / duration)
    } else {
        f64::from(u8::from(t >= start))
    }
}

/// Returns the value at `t` of a sine from `begin` to `end` (s) that grows and dies away over at most `fades` (s); 0 outside.
pub fn sine_between(
    amplitude: f64,
    t: f64,
    [begin, end]: [f64; 2],
    frequency: f64,
    fades: [f64; 2],
) -> f64 {
    if t <= begin || t >= end || frequency == 0.0 {
        return 0.0;
    }
    let fade = FADE_PERIODS / frequency;
    let grown = smooth_step((t - begin) / fade.min(fades[0]));
    let left = smooth_step((end - t) / fade.min(fades[1]));
    let angle = std::f64::consts::TAU * frequency * (t - begin);
    amplitude * grown * left * libm::sin(angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steepest(law: fn(f64) -> f64) -> f64 {
        let n = 100_000;
        (0..n)
            .map(|i| (law((i + 1) as f64 / n as f64) - law(i as f64 / n as f64)) * n as f64)
            .fold(0.0, f64::max)
    }

    #[test]
    fn laws_run_from_zero_to_one_and_stay_there() {
        for law in [smooth_step, travel] {
            assert_eq!(law(-1.0), 0.0);
            assert_eq!(law(0.0), 0.0);
            assert!((law(0.5) - 0.5).abs() < 1e-15);
            assert_eq!(law(1.0), 1.0);
            assert_eq!(law(7.0), 1.0);
        }
    }

    #[test]
    fn peak_rates_are_those_stated() {
        assert_eq!([SMOOTH_STEP_PEAK, TRAVEL_PEAK], [1.875, 1.25]);
        assert!((steepest(smooth_step) - SMOOTH_STEP_PEAK).abs() < 1e-6);
        assert!((steepest(travel) - TRAVEL_PEAK).abs() < 1e-6);
    }

    #[test]
    fn speed_has_no_jump_anywhere() {
        let e = 1e-5;
        for law in [smooth_step, travel] {
            let speed = |u: f64| (law(u + e) - law(u - e)) / (2.0 * e);
            for i in -10..1010 {
                let u = i as f64 / 1000.0;
                let jump = (speed(u + 1e-4) - speed(u - 1e-4)).abs();
                assert!(jump < 3e-3, "{u}: {jump}");
            }
        }
    }
}

//! Schemes on a spring: known motion, convergence, lost energy, failed windows.

use crate::press::Press;
use crate::spring_bed::{STEP_NS, SpringBed};
use ballast_coupling::{Coupling, CouplingAcceleration, CouplingSettings, Error, Scheme, Window};
use ballast_protocol::lockstep::WindowKind;

const STIFFNESS: f64 = 8e5;
const SPEED: f64 = -0.3;
const ACCELERATIONS: [CouplingAcceleration; 3] =
    [CouplingAcceleration::Fixed, CouplingAcceleration::Aitken, CouplingAcceleration::IqnIls];

fn couple(settings: CouplingSettings) -> Coupling<SpringBed, Press> {
    Coupling::new(SpringBed::new(STIFFNESS), Press::new("tine", SPEED), settings).unwrap()
}

fn explicit(scheme: Scheme, window_steps: u32) -> CouplingSettings {
    CouplingSettings { scheme, window_steps, ..CouplingSettings::default() }
}

fn run(coupling: &mut Coupling<SpringBed, Press>, windows: usize) -> Vec<Window> {
    (0..windows).map(|_| coupling.advance().unwrap()).collect()
}

/// Returns the height of a mass between two springs, one of which is moved at a speed, without damping.
fn exact_height(press: &Press, t: f64) -> f64 {
    let stiffness = press.stiffness + STIFFNESS;
    let frequency = (stiffness / press.mass).sqrt();
    press.stiffness * press.speed / stiffness * (t - (frequency * t).sin() / frequency)
}

#[test]
fn implicit_windows_follow_the_exact_motion() {
    for acceleration in ACCELERATIONS {
        let settings = CouplingSettings {
            acceleration,
            tolerance: 1e-10,
            max_iterations: 40,
            ..Default::default()
        };
        let press = Press { damping: 0.0, ..Press::new("tine", SPEED) };
        let mut coupling = Coupling::new(SpringBed::new(STIFFNESS), press, settings).unwrap();
        for _ in 0..40 {
            let window = coupling.advance().unwrap();
            assert!(window.is_converged && window.residual <= 1e-10, "{acceleration:?}");
            let t = window.reply.t1_ns as f64 * 1e-9;
            let exact = exact_height(coupling.partner(), t);
            let largest = exact_height(coupling.partner(), 0.08).abs();
            assert!((window.motion["tine"][2] - exact).abs() < 0.01 * largest, "{acceleration:?}");
            assert!(window.energy_residual().abs() < 1e-6, "{acceleration:?}");
        }
    }
}

/// Iterations, last residual and last work of ten windows of four steps in `ballast.couple`.
#[test]
fn windows_are_those_of_python() {
    use CouplingAcceleration::{Aitken, Fixed, IqnIls};
    let implicit = |acceleration| CouplingSettings { acceleration, ..Default::default() };
    for (settings, iterations, residual, work) in [
        (
            implicit(Fixed),
            [1, 1, 2, 3, 4, 4, 5, 5, 5, 5],
            5.458501597130978e-7,
            0.01644471334107696,
        ),
        (
            implicit(Aitken),
            [1, 1, 2, 3, 3, 3, 3, 3, 3, 3],
            1.3550049946550562e-8,
            0.01646614890541407,
        ),
        (
            implicit(IqnIls),
            [1, 1, 2, 3, 2, 2, 2, 2, 2, 2],
            1.8754636920537528e-8,
            0.016467713561924734,
        ),
        (explicit(Scheme::Parallel, 4), [1; 10], 1.4748994530640379e-5, 0.024673969596460756),
        (explicit(Scheme::Staggered, 4), [1; 10], 0.0, 0.023539793272163573),
    ] {
        let mut coupling = couple(settings.clone());
        let windows = run(&mut coupling, 10);
        let found: Vec<u32> = windows.iter().map(|w| w.iterations).collect();
        assert_eq!(found, iterations, "{settings:?}");
        assert!((windows[9].residual - residual).abs() <= 1e-14, "{settings:?}");
        assert!((windows[9].work_given - work).abs() <= 1e-11, "{settings:?}");
        let explicit = u32::from(settings.scheme != Scheme::Implicit);
        assert_eq!(coupling.partner().calls, found.iter().sum::<u32>() + 10 * (1 - explicit));
    }
}

#[test]
fn explicit_schemes_lose_energy_and_improve_with_shorter_windows() {
    let lost = |settings: CouplingSettings| {
        let windows = run(&mut couple(settings.clone()), 120 / settings.window_steps as usize);
        windows.iter().map(|w| w.energy_residual().abs()).sum::<f64>()
    };
    let implicit = lost(CouplingSettings::default());
    for scheme in [Scheme::Parallel, Scheme::Staggered] {
        let (long, short) = (lost(explicit(scheme, 4)), lost(explicit(scheme, 1)));
        assert!(10.0 * implicit < short && short < 0.5 * long, "{scheme:?}: {short} {long}");
    }
}

#[test]
fn both_sides_compute_every_explicit_window_once() {
    for scheme in [Scheme::Parallel, Scheme::Staggered] {
        let mut coupling = couple(explicit(scheme, 2));
        assert!(run(&mut coupling, 10).iter().all(|w| w.iterations == 1 && w.is_converged));
        assert_eq!(coupling.partner().calls, 10);
        let windows: Vec<_> = (0..10).map(|k| [2 * k * STEP_NS, 2 * (k + 1) * STEP_NS]).collect();
        let requests = &coupling.simulation().requests;
        assert!(requests.iter().all(|(kind, _)| *kind == WindowKind::Advance));
        assert_eq!(requests.iter().map(|(_, ends)| *ends).collect::<Vec<_>>(), windows);
    }
}

#[test]
fn a_failed_window_leaves_both_sides_at_its_start() {
    let mut coupling = couple(CouplingSettings::default());
    run(&mut coupling, 5);
    let (mut bed, press) = coupling.into_sides();
    bed.limit = 0.0;
    let (now_ns, state) = (bed.now_ns, press.state);
    let mut coupling = Coupling::new(bed, press, CouplingSettings::default()).unwrap();
    for _ in 0..2 {
        let error = coupling.advance().unwrap_err();
        assert!(matches!(&error, Error::Window(reply) if reply.message == "too far"), "{error}");
        assert_eq!((coupling.simulation().now_ns, coupling.partner().state), (now_ns, state));
    }
}

#[test]
fn a_refused_guess_is_followed_by_one_half_the_way() {
    let mut undisturbed = couple(CouplingSettings::default());
    let expected = run(&mut undisturbed, 6)[5].motion["tine"];
    let before = undisturbed.simulation().requests.len();
    let [.., (last, _)] = undisturbed.simulation().requests[..] else { panic!("requests") };
    assert_eq!(last, WindowKind::Redo, "the sixth window is repeated");
    // The last guess of the sixth window, which does not come again like this.
    let bed = SpringBed { refused: Some(before - 1), ..SpringBed::new(STIFFNESS) };
    let press = Press::new("tine", SPEED);
    let mut coupling = Coupling::new(bed, press, CouplingSettings::default()).unwrap();
    let window = run(&mut coupling, 6).pop().unwrap();
    assert!(coupling.simulation().requests.len() > before && window.is_converged);
    assert!((window.motion["tine"][2] - expected[2]).abs() < 2e-6);
}

#[test]
fn a_window_in_which_the_partner_fails_is_repeated() {
    let mut undisturbed = couple(CouplingSettings::default());
    let expected = run(&mut undisturbed, 6)[5].motion["tine"];
    // The answer to the first forces of the sixth window.
    let failing_call = undisturbed.partner().calls - 1;
    let press = Press { failing_call, ..Press::new("tine", SPEED) };
    let bed = SpringBed::new(STIFFNESS);
    let mut coupling = Coupling::new(bed, press, CouplingSettings::default()).unwrap();
    run(&mut coupling, 5);
    let error = coupling.advance().unwrap_err();
    assert_eq!(error.to_string(), "partner: out of oil");
    let ends = [20 * STEP_NS, 24 * STEP_NS];
    assert_eq!(coupling.simulation().requests.last(), Some(&(WindowKind::Advance, ends)));
    let window = coupling.advance().unwrap();
    assert_eq!(coupling.simulation().requests.last(), Some(&(WindowKind::Redo, ends)));
    assert!((window.motion["tine"][2] - expected[2]).abs() < 2e-6);
}

#[test]
fn settings_out_of_range_are_refused() {
    for (name, settings) in [
        ("relaxation", CouplingSettings { relaxation: 0.0, ..Default::default() }),
        ("window_steps", CouplingSettings { window_steps: 0, ..Default::default() }),
        ("max_iterations", CouplingSettings { max_iterations: 0, ..Default::default() }),
        ("tolerance", CouplingSettings { tolerance: 0.0, ..Default::default() }),
        ("lever", CouplingSettings { lever: f64::INFINITY, ..Default::default() }),
    ] {
        let press = Press::new("tine", SPEED);
        let made = Coupling::new(SpringBed::new(STIFFNESS), press, settings);
        assert!(made.err().is_some_and(|e| e.to_string().starts_with(name)), "{name}");
    }
    assert_eq!("iqn-ils".parse::<CouplingAcceleration>().unwrap(), CouplingAcceleration::IqnIls);
    assert_eq!("staggered".parse::<Scheme>().unwrap(), Scheme::Staggered);
    let error = "loose".parse::<Scheme>().unwrap_err().to_string();
    assert_eq!(error, "scheme: expected one of parallel, staggered, implicit, found loose");
}

#[test]
fn bodies_that_a_partner_cannot_move_are_refused() {
    for (name, message) in [("sprung", "set `rigid = true`"), ("wheel", "none of this name")] {
        let press = Press::new(name, SPEED);
        let settings = CouplingSettings::default();
        let mut coupling = Coupling::new(SpringBed::new(STIFFNESS), press, settings).unwrap();
        let error = coupling.advance().unwrap_err().to_string();
        assert!(error.starts_with(name) && error.contains(message), "{error}");
    }
}

//! Random legal and illegal calls: no crash, no hang, and a status of the standard.

use crate::driver::{VERSIONS, Version, instantiate, unpacked};
use ballast_fmu::variables::ARRAYS;
use ballast_fmu::{fmi2, fmi3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::ffi::{c_char, c_int, c_void};
use std::ptr::{null, null_mut};

const CALLS: u32 = 10_000;
/// Room for the values of a call.
const ROOM: usize = 64;

/// Arguments of calls, of which some are illegal.
struct Caller {
    rng: Pcg64,
    instance: *mut c_void,
    states: [*mut c_void; 3],
    bytes: Vec<u8>,
    time: f64,
}

impl Caller {
    fn new(seed: u64) -> Self {
        let rng = Pcg64::seed_from_u64(seed);
        Self { rng, instance: null_mut(), states: [null_mut(); 3], bytes: vec![], time: 0.0 }
    }

    /// Returns true in this percentage of the calls.
    fn happens(&mut self, percent: u32) -> bool {
        self.rng.random_range(0..100) < percent
    }

    /// Returns the instance, seldom null.
    fn instance(&mut self) -> *mut c_void {
        if self.happens(3) { null_mut() } else { self.instance }
    }

    fn number(&mut self) -> f64 {
        match self.rng.random_range(0..8) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => -1e300,
            3 => 0.0,
            4 => 1.0,
            5 => 2.0,
            _ => self.rng.random_range(-0.3..0.3),
        }
    }

    fn references(&mut self) -> Vec<u32> {
        let elements = unpacked().table.element_count() as u32;
        let count = self.rng.random_range(0..5);
        (0..count)
            .map(|_| match self.rng.random_range(0..5) {
                0 => ARRAYS + self.rng.random_range(0..elements),
                1 => self.rng.random_range(0..=u32::MAX),
                _ => self.rng.random_range(0..elements + 2),
            })
            .collect()
    }

    /// Returns a pointer, seldom null.
    fn pointer<T>(&mut self, first: *mut T) -> *mut T {
        if self.happens(5) { null_mut() } else { first }
    }

    /// Returns time and length of a step, mostly as the instance expects them.
    fn step(&mut self) -> [f64; 2] {
        const ILLEGAL: [f64; 7] = [f64::NAN, f64::INFINITY, -1e300, 0.0, 5e-4, 1e300, -1e-3];
        let length = if self.happens(70) { 1e-3 } else { ILLEGAL[self.rng.random_range(0..7)] };
        [if self.happens(80) { self.time } else { self.number() }, length]
    }

    fn slot(&mut self) -> usize {
        self.rng.random_range(0..self.states.len())
    }
}

/// Calls one function of FMI 2.0.
unsafe fn call2(x: &mut Caller) -> c_int {
    let c = x.instance();
    let vr = x.references();
    let n = vr.len();
    let vr = x.pointer(vr.as_ptr().cast_mut()).cast_const();
    let mut reals = [0.0; ROOM];
    reals.fill_with(|| x.number());
    let mut wholes = [0; ROOM];
    wholes.fill_with(|| x.rng.random_range(-2..4));
    let mut texts: [*const c_char; ROOM] = [null(); ROOM];
    let (real, whole) = (x.pointer(reals.as_mut_ptr()), x.pointer(wholes.as_mut_ptr()));
    let (slot, other) = (x.slot(), x.number());
    let mut size = 0;
    unsafe {
        match x.rng.random_range(0..40) {
            0 => fmi2::fmi2SetupExperiment(
                c,
                0,
                0.0,
                if x.happens(90) { 0.0 } else { other },
                0,
                0.0,
            ),
            1 => fmi2::fmi2EnterInitializationMode(c),
            2 => fmi2::fmi2ExitInitializationMode(c),
            3 if x.happens(5) => fmi2::fmi2Terminate(c),
            4 if x.happens(20) => fmi2::fmi2Reset(c),
            5 => fmi2::fmi2GetReal(c, vr, n, real),
            6 => fmi2::fmi2GetInteger(c, vr, n, whole),
            7 => fmi2::fmi2GetBoolean(c, vr, n, whole),
            8 => fmi2::fmi2GetString(c, vr, n, texts.as_mut_ptr()),
            9 => fmi2::fmi2SetReal(c, vr, n, real),
            10 => fmi2::fmi2SetInteger(c, vr, n, whole),
            11 => fmi2::fmi2SetBoolean(c, vr, n, whole),
            12 => fmi2::fmi2SetString(c, vr, n, texts.as_ptr()),
            13 => {
                let place: *mut *mut c_void = &mut x.states[slot];
                let place = x.pointer(place);
                fmi2::fmi2GetFMUstate(c, place)
            }
            14 => fmi2::fmi2SetFMUstate(c, x.states[slot]),
            15 => fmi2::fmi2FreeFMUstate(c, &mut x.states[slot]),
            16 => {
                let status = fmi2::fmi2SerializedFMUstateSize(c, x.states[slot], &mut size);
                x.bytes.resize(size, 0);
                let (first, given) =
                    (x.bytes.as_mut_ptr(), size - size.min(usize::from(x.happens(20))));
                status.max(fmi2::fmi2SerializeFMUstate(c, x.states[slot], first, given))
            }
            17 => {
                if let Some(byte) = x.bytes.last_mut() {
                    *byte ^= u8::from(slot == 0);
                }
                let (first, len) = (x.bytes.as_ptr(), x.bytes.len());
                fmi2::fmi2DeSerializeFMUstate(c, first, len, &mut x.states[slot])
            }
            18 => fmi2::fmi2CancelStep(c),
            19 => fmi2::fmi2GetStatus(c, slot as c_int, whole),
            20 => fmi2::fmi2GetRealStatus(c, slot as c_int, real),
            21 => fmi2::fmi2GetIntegerStatus(c, slot as c_int, whole),
            22 => fmi2::fmi2GetBooleanStatus(c, 3 - slot as c_int, whole),
            23 => fmi2::fmi2GetStringStatus(c, slot as c_int, texts.as_mut_ptr()),
            24 => fmi2::fmi2SetDebugLogging(c, 1, 1, [c"logStatusError".as_ptr()].as_ptr()),
            25 => fmi2::fmi2SetDebugLogging(c, 0, 1, [c"other".as_ptr()].as_ptr()),
            26 => fmi2::fmi2GetDirectionalDerivative(c, vr, n, vr, n, real, real),
            27 => fmi2::fmi2SetRealInputDerivatives(c, vr, n, whole, real),
            28 => fmi2::fmi2GetRealOutputDerivatives(c, vr, n, whole, real),
            29 => fmi2::fmi2EnterEventMode(c),
            30 => fmi2::fmi2NewDiscreteStates(c, null_mut()),
            31 => fmi2::fmi2CompletedIntegratorStep(c, 1, whole, whole),
            32 => fmi2::fmi2SetTime(c, other),
            33 => {
                fmi2::fmi2SetContinuousStates(c, real, n) + fmi2::fmi2GetDerivatives(c, real, n) - 3
            }
            _ => {
                let [time, length] = x.step();
                let status = fmi2::fmi2DoStep(c, time, length, 1);
                fmi2::fmi2GetRealStatus(x.instance, 2, &mut x.time);
                status
            }
        }
    }
}

/// Calls one function of FMI 3.0.
unsafe fn call3(x: &mut Caller) -> c_int {
    let c = x.instance();
    let vr = x.references();
    let n = vr.len();
    let vr = x.pointer(vr.as_ptr().cast_mut()).cast_const();
    let count = if x.happens(60) { n } else { x.rng.random_range(0..ROOM) };
    let mut reals = [0.0; ROOM];
    reals.fill_with(|| x.number());
    let mut wholes = [0_i64; ROOM];
    wholes.fill_with(|| x.rng.random_range(-2..4));
    let mut texts: [*const c_char; ROOM] = [null(); ROOM];
    let (real, whole) = (x.pointer(reals.as_mut_ptr()), x.pointer(wholes.as_mut_ptr()));
    let (slot, other) = (x.slot(), x.number());
    let mut size = 0;
    unsafe {
        match x.rng.random_range(0..43) {
            0 => fmi3::fmi3EnterInitializationMode(
                c,
                0,
                0.0,
                if x.happens(90) { 0.0 } else { other },
                0,
                0.0,
            ),
            1 | 2 => fmi3::fmi3ExitInitializationMode(c),
            3 if x.happens(5) => fmi3::fmi3Terminate(c),
            4 if x.happens(20) => fmi3::fmi3Reset(c),
            5 => fmi3::fmi3GetFloat64(c, vr, n, real, count),
            6 => fmi3::fmi3SetFloat64(c, vr, n, real, count),
            7 => fmi3::fmi3GetInt32(c, vr, n, whole.cast(), count),
            8 => fmi3::fmi3SetInt32(c, vr, n, whole.cast(), count),
            9 => fmi3::fmi3GetInt64(c, vr, n, whole, count),
            10 => fmi3::fmi3SetInt64(c, vr, n, whole, count),
            11 => fmi3::fmi3GetString(c, vr, n, texts.as_mut_ptr(), count),
            12 => fmi3::fmi3SetString(c, vr, n, texts.as_ptr(), count),
            13 => {
                let place: *mut *mut c_void = &mut x.states[slot];
                let place = x.pointer(place);
                fmi3::fmi3GetFMUState(c, place)
            }
            14 => fmi3::fmi3SetFMUState(c, x.states[slot]),
            15 => fmi3::fmi3FreeFMUState(c, &mut x.states[slot]),
            16 => {
                let status = fmi3::fmi3SerializedFMUStateSize(c, x.states[slot], &mut size);
                x.bytes.resize(size, 0);
                let (first, given) =
                    (x.bytes.as_mut_ptr(), size - size.min(usize::from(x.happens(20))));
                status.max(fmi3::fmi3SerializeFMUState(c, x.states[slot], first, given))
            }
            17 => {
                if let Some(byte) = x.bytes.last_mut() {
                    *byte ^= u8::from(slot == 0);
                }
                let (first, len) = (x.bytes.as_ptr(), x.bytes.len());
                fmi3::fmi3DeserializeFMUState(c, first, len, &mut x.states[slot])
            }
            18 => fmi3::fmi3GetBinary(c, vr, n, null_mut(), null_mut(), count),
            19 => fmi3::fmi3SetBinary(c, vr, n, null(), null(), count),
            20 => fmi3::fmi3GetClock(c, vr, n, null_mut()),
            21 => fmi3::fmi3SetClock(c, vr, n, null()),
            22 => fmi3::fmi3GetBoolean(c, vr, n, null_mut(), count),
            23 => fmi3::fmi3SetBoolean(c, vr, n, null(), count),
            24 => fmi3::fmi3GetFloat32(c, vr, n, null_mut(), count),
            25 => fmi3::fmi3SetUInt64(c, vr, n, null(), count),
            26 => fmi3::fmi3EnterEventMode(c),
            27 => fmi3::fmi3EnterConfigurationMode(c),
            28 => fmi3::fmi3EnterStepMode(c),
            29 => fmi3::fmi3GetDirectionalDerivative(c, vr, n, vr, n, real, n, real, n),
            30 => fmi3::fmi3GetOutputDerivatives(c, vr, n, null(), real, n),
            31 => fmi3::fmi3GetIntervalDecimal(c, vr, n, real, null_mut()),
            32 => fmi3::fmi3EvaluateDiscreteStates(c),
            33 => fmi3::fmi3ActivateModelPartition(c, 1, other),
            34 => fmi3::fmi3GetNumberOfContinuousStates(c, &mut size),
            35 => fmi3::fmi3SetDebugLogging(c, 1, 0, null()),
            36 => fmi3::fmi3SetDebugLogging(c, 1, n, null()),
            _ => {
                let [time, length] = x.step();
                let (mut flags, mut early) = ([9; 2], 9);
                let [event, terminate] = &mut flags;
                let status =
                    fmi3::fmi3DoStep(c, time, length, 1, event, terminate, &mut early, &mut x.time);
                assert!(early <= 1 || c.is_null() || status == 3);
                status
            }
        }
    }
}

#[test]
fn random_calls_end_with_a_status() {
    let unit = unpacked();
    for (version, seed) in VERSIONS.into_iter().zip(1..) {
        let mut caller = Caller::new(seed);
        let mut counts = [0; 4];
        let mut steps = 0;
        for k in 0..CALLS {
            if k % 500 == 0 {
                free(version, caller.instance);
                caller.instance =
                    instantiate(version, unit.resources.path(), &unit.token, k % 1000 == 0);
                caller.time = 0.0;
            }
            let before = caller.time;
            let status = unsafe {
                match version {
                    Version::Two => call2(&mut caller),
                    Version::Three => call3(&mut caller),
                }
            };
            assert!((0..=3).contains(&status), "{version:?}, call {k}: {status}");
            counts[status as usize] += 1;
            steps += u32::from(caller.time > before);
        }
        // Calls of every kind were made: done ones, illegal ones, and steps.
        assert!(counts[0] > 1000 && counts[2] > 30 && counts[3] > 1000, "{counts:?}");
        assert!(steps > 100, "{steps} steps");
        unsafe {
            for mut state in caller.states {
                match version {
                    Version::Two => fmi2::fmi2FreeFMUstate(caller.instance, &mut state),
                    Version::Three => fmi3::fmi3FreeFMUState(caller.instance, &mut state),
                };
            }
        }
        free(version, caller.instance);
    }
}

fn free(version: Version, instance: *mut c_void) {
    unsafe {
        match version {
            Version::Two => fmi2::fmi2FreeInstance(instance),
            Version::Three => fmi3::fmi3FreeInstance(instance),
        }
    }
}

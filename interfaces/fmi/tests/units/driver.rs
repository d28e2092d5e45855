//! Bed of the tests, and an importer of both versions.

use ballast::track;
use ballast_fmu::bed::{BED_FILE, UnitBed, instantiation_token};
use ballast_fmu::variable_table::VariableTable;
use ballast_fmu::{fmi2, fmi3};
use ballast_scenario::CaseOverrides;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ops::ControlFlow;
use std::path::Path;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

pub const CASE: &str = include_str!("../../../cli/tests/data/tiny.toml");

/// Unit of the small case, unpacked.
pub struct Unpacked {
    pub bed: UnitBed,
    pub table: VariableTable,
    pub resources: tempfile::TempDir,
    pub token: CString,
}

fn unpacked_of(case: &str) -> Unpacked {
    let plan = ballast_scenario::read_case(case, "tiny").unwrap().plan;
    let bed = track::deposit(&plan, &mut |_| ControlFlow::Continue(())).unwrap().unwrap();
    let (model, state) = track::scene(&plan, bed).unwrap();
    let bed = UnitBed::new(model, state, case.into(), CaseOverrides::default()).unwrap();
    let bytes = bed.to_bytes();
    let resources = tempfile::tempdir().unwrap();
    std::fs::write(resources.path().join(BED_FILE), &bytes).unwrap();
    let token = CString::new(instantiation_token(&bytes)).unwrap();
    Unpacked { table: VariableTable::new(&bed), bed, resources, token }
}

/// Returns the unit of the small case.
pub fn unpacked() -> &'static Unpacked {
    static UNIT: OnceLock<Unpacked> = OnceLock::new();
    UNIT.get_or_init(|| unpacked_of(CASE))
}

/// Returns the unit of the small case whose sleeper moves vertically under loads.
pub fn unpacked_with_free_sleeper() -> &'static Unpacked {
    static UNIT: OnceLock<Unpacked> = OnceLock::new();
    UNIT.get_or_init(|| {
        let (bed, _) = CASE.split_once("[tines]").unwrap();
        let (_, run) = CASE.split_once("[run]").unwrap();
        let bed = bed.replace("tamped = [1]", "mount = { mass_kg = 3.0, z = \"free\" }");
        unpacked_of(&format!("{bed}[run]{run}"))
    })
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Version {
    Two,
    Three,
}

pub const VERSIONS: [Version; 2] = [Version::Two, Version::Three];

/// Creates an instance; null if the unit refuses it.
pub fn instantiate(version: Version, resources: &Path, token: &CStr, early: bool) -> *mut c_void {
    let path = resources.to_str().unwrap();
    let uri = CString::new(format!("file://{path}")).unwrap();
    let path = CString::new(path).unwrap();
    unsafe {
        match version {
            Version::Two => fmi2::fmi2Instantiate(
                c"unit".as_ptr(),
                1,
                token.as_ptr(),
                uri.as_ptr(),
                null(),
                0,
                1,
            ),
            Version::Three => fmi3::fmi3InstantiateCoSimulation(
                c"unit".as_ptr(),
                token.as_ptr(),
                path.as_ptr(),
                0,
                1,
                0,
                early.into(),
                null(),
                0,
                null_mut(),
                None,
                null_mut(),
            ),
        }
    }
}

/// Instance that an importer drives; every call must succeed unless its status is asked for.
pub struct Importer {
    pub version: Version,
    pub instance: *mut c_void,
    unit: &'static Unpacked,
}

impl Drop for Importer {
    fn drop(&mut self) {
        unsafe {
            match self.version {
                Version::Two => fmi2::fmi2FreeInstance(self.instance),
                Version::Three => fmi3::fmi3FreeInstance(self.instance),
            }
        }
    }
}

impl Importer {
    pub fn new(version: Version, unit: &'static Unpacked) -> Self {
        Self::with_early_return(version, unit, false)
    }

    /// Creates an instance of an importer that accepts steps that end early, or does not.
    pub fn with_early_return(version: Version, unit: &'static Unpacked, early: bool) -> Self {
        let instance = instantiate(version, unit.resources.path(), &unit.token, early);
        assert!(!instance.is_null());
        Self { version, instance, unit }
    }

    /// Creates an instance and initialises it, with `set` in between.
    pub fn ready(version: Version, unit: &'static Unpacked, set: impl FnOnce(&Self)) -> Self {
        let this = Self::new(version, unit);
        set(&this);
        this.initialize();
        this
    }

    pub fn initialize(&self) {
        let c = self.instance;
        unsafe {
            match self.version {
                Version::Two => {
                    assert_eq!(fmi2::fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0), 0);
                    assert_eq!(fmi2::fmi2EnterInitializationMode(c), 0);
                    assert_eq!(fmi2::fmi2ExitInitializationMode(c), 0);
                }
                Version::Three => {
                    assert_eq!(fmi3::fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0), 0);
                    assert_eq!(fmi3::fmi3ExitInitializationMode(c), 0);
                }
            }
        }
    }

    /// Returns the value references of a variable: of its scalars, in FMI 3.0 of the whole array.
    fn references(&self, name: &str) -> (Vec<u32>, usize) {
        let variable = self.unit.table.variables.iter().find(|v| v.name == name);
        let variable = variable.unwrap_or_else(|| panic!("no variable {name}"));
        let references = match self.version {
            Version::Two => variable.elements().map(|e| 1 + e as u32).collect(),
            Version::Three => vec![variable.reference()],
        };
        (references, variable.count)
    }

    pub fn set_status(&self, name: &str, values: &[f64]) -> c_int {
        let ((vr, _), c) = (self.references(name), self.instance);
        unsafe {
            match self.version {
                Version::Two => fmi2::fmi2SetReal(c, vr.as_ptr(), vr.len(), values.as_ptr()),
                Version::Three => {
                    fmi3::fmi3SetFloat64(c, vr.as_ptr(), vr.len(), values.as_ptr(), values.len())
                }
            }
        }
    }

    pub fn set(&self, name: &str, values: &[f64]) {
        assert_eq!(self.set_status(name, values), 0, "{name}");
    }

    /// Sets a whole number or the enumeration.
    pub fn set_whole(&self, name: &str, value: i32) {
        let ((vr, _), c) = (self.references(name), self.instance);
        let status = unsafe {
            match (self.version, name) {
                (Version::Two, _) => fmi2::fmi2SetInteger(c, vr.as_ptr(), 1, &value),
                (Version::Three, "inputs_at") => {
                    fmi3::fmi3SetInt64(c, vr.as_ptr(), 1, &i64::from(value), 1)
                }
                (Version::Three, _) => fmi3::fmi3SetInt32(c, vr.as_ptr(), 1, &value, 1),
            }
        };
        assert_eq!(status, 0, "{name}");
    }

    pub fn get(&self, name: &str) -> Vec<f64> {
        let ((vr, count), c) = (self.references(name), self.instance);
        let mut values = vec![0.0; count];
        let status = unsafe {
            match self.version {
                Version::Two => fmi2::fmi2GetReal(c, vr.as_ptr(), vr.len(), values.as_mut_ptr()),
                Version::Three => {
                    fmi3::fmi3GetFloat64(c, vr.as_ptr(), vr.len(), values.as_mut_ptr(), count)
                }
            }
        };
        assert_eq!(status, 0, "{name}");
        values
    }

    pub fn hash(&self) -> String {
        let ((vr, _), c) = (self.references("state_hash"), self.instance);
        let mut text: *const c_char = null();
        unsafe {
            match self.version {
                Version::Two => assert_eq!(fmi2::fmi2GetString(c, vr.as_ptr(), 1, &mut text), 0),
                Version::Three => {
                    assert_eq!(fmi3::fmi3GetString(c, vr.as_ptr(), 1, &mut text, 1), 0);
                }
            }
            CStr::from_ptr(text).to_str().unwrap().into()
        }
    }

    /// Advances; returns status, early return and last successful time.
    pub fn step_status(&self, time: f64, length: f64) -> (c_int, bool, f64) {
        let (mut early, mut last) = (9, f64::NAN);
        let (mut event, mut terminate) = (9, 9);
        unsafe {
            let status = match self.version {
                Version::Two => {
                    let status = fmi2::fmi2DoStep(self.instance, time, length, 0);
                    assert_eq!(fmi2::fmi2GetRealStatus(self.instance, 2, &mut last), 0);
                    early = 0;
                    status
                }
                Version::Three => {
                    let c = self.instance;
                    let status = fmi3::fmi3DoStep(
                        c,
                        time,
                        length,
                        0,
                        &mut event,
                        &mut terminate,
                        &mut early,
                        &mut last,
                    );
                    assert_eq!((event, terminate), (0, 0));
                    status
                }
            };
            (status, early != 0, last)
        }
    }

    /// Advances by a step that does not fail; it may have steps that did not converge.
    pub fn step(&self, time: f64, length: f64) {
        let (status, early, _) = self.step_status(time, length);
        assert!(status <= 1 && !early, "status {status} at {time} s");
    }

    pub fn save(&self, state: &mut *mut c_void) {
        let status = unsafe {
            match self.version {
                Version::Two => fmi2::fmi2GetFMUstate(self.instance, state),
                Version::Three => fmi3::fmi3GetFMUState(self.instance, state),
            }
        };
        assert_eq!(status, 0);
    }

    pub fn restore_status(&self, state: *mut c_void) -> c_int {
        unsafe {
            match self.version {
                Version::Two => fmi2::fmi2SetFMUstate(self.instance, state),
                Version::Three => fmi3::fmi3SetFMUState(self.instance, state),
            }
        }
    }

    pub fn drop_state(&self, mut state: *mut c_void) {
        unsafe {
            match self.version {
                Version::Two => assert_eq!(fmi2::fmi2FreeFMUstate(self.instance, &mut state), 0),
                Version::Three => assert_eq!(fmi3::fmi3FreeFMUState(self.instance, &mut state), 0),
            }
        }
        assert!(state.is_null());
    }

    pub fn serialize(&self, state: *mut c_void) -> Vec<u8> {
        let (mut size, c) = (0, self.instance);
        unsafe {
            match self.version {
                Version::Two => {
                    assert_eq!(fmi2::fmi2SerializedFMUstateSize(c, state, &mut size), 0);
                    let mut bytes = vec![0; size];
                    assert_eq!(fmi2::fmi2SerializeFMUstate(c, state, bytes.as_mut_ptr(), size), 0);
                    bytes
                }
                Version::Three => {
                    assert_eq!(fmi3::fmi3SerializedFMUStateSize(c, state, &mut size), 0);
                    let mut bytes = vec![0; size];
                    assert_eq!(fmi3::fmi3SerializeFMUState(c, state, bytes.as_mut_ptr(), size), 0);
                    bytes
                }
            }
        }
    }

    pub fn deserialize(&self, bytes: &[u8], state: &mut *mut c_void) -> c_int {
        let (c, first, size) = (self.instance, bytes.as_ptr(), bytes.len());
        unsafe {
            match self.version {
                Version::Two => fmi2::fmi2DeSerializeFMUstate(c, first, size, state),
                Version::Three => fmi3::fmi3DeserializeFMUState(c, first, size, state),
            }
        }
    }
}

/// Returns position and velocity of the middle tine at a time, s: a vibration.
pub fn motion(time: f64) -> ([f64; 3], [f64; 3]) {
    let (amplitude, rate) = (0.002, 2.0 * std::f64::consts::PI * 35.0);
    let x = 0.054 + amplitude * (1.0 - (rate * time).cos());
    ([x, 0.05, 0.125 - 0.2 * time], [amplitude * rate * (rate * time).sin(), 0.0, -0.2])
}

pub const TINE: &str = "tine_1_plus";

/// Sets the motion of the tine at a time, s.
pub fn set_motion(importer: &Importer, time: f64) {
    let (position, velocity) = motion(time);
    importer.set(&format!("{TINE}.position"), &position);
    importer.set(&format!("{TINE}.velocity"), &velocity);
}

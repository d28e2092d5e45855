//! Drivers: their inputs, and their state as part of the component's.

use crate::{FLOOR, MS, floor, floor_knot, heap};
use ballast::component::{
    Component, Driver, FunctionDriver, Interpolation, Limits, MotionInput, Refusal, Session,
    Waveform, WindowInputs,
};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::{DriverState, State};
use ballast::step::StepReport;

/// Motion of the shaken floor in one window.
fn shaken(rest: Pose, t0_ns: u64, t1_ns: u64) -> MotionInput {
    let knots = vec![floor_knot(rest, t0_ns), floor_knot(rest, t1_ns)];
    let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
    MotionInput { body: FLOOR.into(), waveform, allow_jump: false }
}

/// Shakes the floor, and counts the steps up to a limit.
struct Counter {
    rest: Pose,
    count: f64,
    limit: f64,
}

impl Driver for Counter {
    type Error = Refusal;

    fn inputs(
        &mut self,
        component: &Component,
        end_ns: u64,
    ) -> Result<Option<WindowInputs>, Refusal> {
        let motions = vec![shaken(self.rest, component.now_ns(), end_ns)];
        Ok((self.count < self.limit).then_some(WindowInputs { motions, loads: Vec::new() }))
    }

    fn observe(&mut self, _: &Model, _: &State, _: &StepReport) {
        self.count += 1.0;
    }

    fn save(&self) -> DriverState {
        DriverState { kind: "counter".into(), version: 1, values: vec![self.count] }
    }

    fn restore(&mut self, saved: &DriverState) -> Result<(), Refusal> {
        self.count = saved.values_of("counter", 1)?.map_or(0.0, |values| values[0]);
        Ok(())
    }
}

#[test]
fn the_state_of_a_driver_follows_the_component() {
    let component = heap(Limits::default());
    let rest = floor(&component);
    let mut session = Session::new(component, Counter { rest, count: 0.0, limit: 20.0 });
    let count = |session: &Session<Counter>| session.component().state().driver.values.clone();
    for _ in 0..10 {
        session.step(&mut ()).expect("a step").expect("inputs");
    }
    let kept = session.component().save();
    assert_eq!((count(&session), kept.step), (vec![10.0], 10));
    let mut steps = 0;
    while let Some(window) = session.step(&mut ()).expect("a step") {
        assert_eq!(window.result.steps, 1);
        steps += 1;
    }
    assert_eq!((steps, count(&session)), (10, vec![20.0]));
    let end = session.component().save();
    // A redo with other inputs begins with the driver's state before the window.
    session.parts_mut().1.redo(&[shaken(rest, 19 * MS, 20 * MS)]).expect("a redo");
    assert_eq!(count(&session), [19.0]);
    session.parts_mut().1.restore(kept).expect("a state of this component");
    while session.step(&mut ()).expect("a step").is_some() {}
    assert_eq!(session.component().save(), end);
}

#[test]
fn a_function_drives_as_inputs_do() {
    let mut driven = heap(Limits::default());
    let rest = floor(&driven);
    let mut driver = FunctionDriver(|component: &Component, end_ns| {
        let motions = vec![shaken(rest, component.now_ns(), end_ns)];
        Ok(Some(WindowInputs { motions, loads: Vec::new() }))
    });
    let mut given = heap(Limits::default());
    for end in [10 * MS, 15 * MS] {
        let window = driven.advance_driven(end, &mut driver, &mut ()).expect("a window");
        let inputs = [shaken(rest, given.now_ns(), end)];
        assert_eq!(window.expect("inputs").result, given.advance_to(end, &inputs).expect("one"));
    }
    assert_eq!(driven.save(), given.save());
}

#[test]
fn a_state_of_another_driver_is_refused() {
    let mut component = heap(Limits::default());
    let foreign = DriverState { kind: "other".into(), version: 1, values: vec![] };
    let state = State { driver: foreign.into(), ..component.state().clone() };
    component.restore(state).expect("a state of this model");
    let before = component.save();
    let mut driver = Counter { rest: floor(&component), count: 0.0, limit: 1.0 };
    let refusal = component.advance_driven(MS, &mut driver, &mut ()).expect_err("another kind");
    assert!(refusal.to_string().contains("expected counter 1, or none, found other 1"));
    assert_eq!(component.save(), before);
}

//! A component with the driver that moves its bodies.

use super::{Component, DrivenWindow, Driver};
use crate::step::StepObserver;

/// Component and the driver that moves its bodies: every run of a case is one.
#[derive(Debug)]
pub struct Session<D> {
    component: Component,
    driver: D,
}

impl<D: Driver> Session<D> {
    /// Joins a component with its driver.
    pub fn new(component: Component, driver: D) -> Self {
        Self { component, driver }
    }

    /// Returns the component.
    pub fn component(&self) -> &Component {
        &self.component
    }

    /// Returns the driver.
    pub fn driver(&self) -> &D {
        &self.driver
    }

    /// Returns the driver and the component.
    pub fn parts_mut(&mut self) -> (&mut D, &mut Component) {
        (&mut self.driver, &mut self.component)
    }

    /// Advances one time step; `None` where the driver has no more inputs.
    ///
    /// # Errors
    /// As for [`Component::advance_driven`].
    pub fn step(
        &mut self,
        observer: &mut impl StepObserver,
    ) -> Result<Option<DrivenWindow>, D::Error> {
        let step_ns = self.component.model().stepping.step_ns;
        let end_ns = self.component.now_ns().saturating_add(step_ns);
        self.component.advance_driven(end_ns, &mut self.driver, observer)
    }
}

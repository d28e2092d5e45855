//! A body on a mass, which a spring moves at a speed.

use ballast_coupling::{ForceRows, MotionRows, Partner, PartnerError};

/// The press; its state is height above the start (m) and speed (m/s).
pub struct Press {
    pub body: &'static str,
    pub mass: f64,
    pub stiffness: f64,
    pub damping: f64,
    pub speed: f64,
    pub state: [f64; 2],
    pub calls: u32,
    /// Number of the call that fails; 0: none.
    pub failing_call: u32,
}

impl Press {
    pub fn new(body: &'static str, speed: f64) -> Self {
        let (mass, stiffness, damping) = (20.0, 5e4, 500.0);
        Self { body, mass, stiffness, damping, speed, state: [0.0; 2], calls: 0, failing_call: 0 }
    }

    fn step(&mut self, middle: f64, h: f64, force: f64) {
        let [z, v] = self.state;
        let inertia = self.mass / h;
        // Implicit midpoint rule.
        let (half_damping, quarter_spring) = (self.damping / 2.0, self.stiffness * h / 4.0);
        let ahead = inertia + half_damping + quarter_spring;
        let spring = self.stiffness * (self.speed * middle - z);
        let faster = ((inertia - half_damping - quarter_spring) * v + spring + force) / ahead;
        self.state = [z + h * (v + faster) / 2.0, faster];
    }
}

impl Partner for Press {
    type State = [f64; 2];

    fn advance(
        &mut self,
        t0: f64,
        t1: f64,
        forces: &ForceRows,
    ) -> Result<MotionRows, PartnerError> {
        self.calls += 1;
        if self.calls == self.failing_call {
            return Err("out of oil".into());
        }
        let rows = forces.get(self.body).map_or(&[[0.0; 6]][..], |rows| rows);
        let h = (t1 - t0) / rows.len() as f64;
        for (k, row) in rows.iter().enumerate() {
            self.step(t0 + (k as f64 + 0.5) * h, h, row[2]);
        }
        let mut row = [0.0; 12];
        [row[2], row[8]] = self.state;
        Ok([(self.body.to_string(), row)].into())
    }

    fn save(&self) -> [f64; 2] {
        self.state
    }

    fn restore(&mut self, state: &[f64; 2]) {
        self.state = *state;
    }
}

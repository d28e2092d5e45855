//! Parameters of the tamping unit: names, values and origins are those of `examples/machine/machine.py`.

use std::f64::consts::PI;

/// Defines parameters with their values, and access to them by name.
macro_rules! parameters {
    ($($(#[doc = $doc:literal])* $name:ident = $value:expr;)*) => {
        /// Parameters of a tamping unit for each two facing tines of a sleeper end.
        #[derive(Debug, Clone)]
        pub struct Parameters { $($(#[doc = $doc])* pub $name: f64,)* }

        impl Default for Parameters {
            fn default() -> Self {
                Self { $($name: $value,)* }
            }
        }

        impl Parameters {
            /// Returns a parameter by its name.
            pub fn by_name(&mut self, name: &str) -> Option<&mut f64> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)*
                    _ => None,
                }
            }
        }
    };
}

parameters! {
    /// Frequency of the eccentric drive, Hz.
    frequency = 35.0;
    /// Amplitude at the blade, m.
    amplitude = 0.004;
    /// Inertia of the eccentric shaft with its flywheel, kg m².
    eccentric_inertia = 0.6;
    /// Largest torque of the motor, N m.
    motor_torque = 400.0;
    /// Gain of the speed controller, N m s/rad.
    motor_gain = 20.0;
    /// Damping of the bearings, N m s/rad.
    bearing_damping = 0.05;

    /// Length of the arm from the pivot to the upper edge of the blade, m.
    lower_length = 0.60;
    /// Length of the arm from the pivot to the cylinder, m.
    upper_length = 0.35;
    /// Inertia of the arm with its tine, kg m².
    arm_inertia = 6.0;
    /// Damping of the pivot, N m s/rad.
    pivot_damping = 20.0;

    /// Bore of a cylinder, m.
    bore = 0.040;
    /// Diameter of the rod, m.
    rod = 0.022;
    /// Stroke of a piston, m.
    cylinder_stroke = 0.055;
    /// Volume of hose and dead volume of each chamber, m³.
    line_volume = 1.0e-4;
    /// Bulk modulus of the oil with hoses and some air, Pa.
    bulk_modulus = 1.0e9;
    /// Friction of the seals, N.
    seal_friction = 250.0;
    /// Speed at which the friction has 76 % of its value, m/s.
    friction_speed = 0.01;
    /// Viscous friction of a cylinder, N s/m.
    viscous_friction = 500.0;
    /// Leakage across the piston, m³/(s Pa).
    leakage = 1e-13;
    /// Stiffness of the end stops, N/m.
    stop_stiffness = 5e7;
    /// Damping of the end stops, N s/m.
    stop_damping = 2e4;

    /// Flow of a squeeze valve per edge and cylinder at 35 bar, m³/s.
    valve_flow = 6.0e-5;
    /// Flow of the check valves to the tank at 35 bar, m³/s.
    check_flow = 4.0e-4;
    /// Time constant of the spool, s.
    valve_time = 0.008;
    /// Pressure at which the relief valve of a chamber opens, Pa.
    relief_pressure = 210e5;
    /// Gain of the relief valve above that pressure, m³/(s Pa).
    relief_gain = 2e-10;
    /// Time constant of each of the two filters of the pressure sensor, s.
    sensor_time = 0.020;
    /// Load pressure at which a pair stops, Pa.
    preset_pressure = 110e5;

    /// Pressure of the supply, Pa.
    supply_pressure = 150e5;
    /// Largest flow of the pump, m³/s.
    pump_flow = 3.0e-3;
    /// Gain of the pressure controller of the pump, m³/(s Pa).
    pump_gain = 1e-9;
    /// Capacity of the accumulator, m³/Pa.
    accumulator = 1.8e-10;

    /// Mass of the unit with its arms, kg.
    unit_mass = 450.0;
    /// Area of the insertion cylinder, m².
    insertion_area = 2.0e-3;
    /// Volume of both chambers of the insertion cylinder with lines, m³.
    insertion_volume = 1.2e-3;
    /// Flow of the insertion valve at 35 bar, m³/s.
    insertion_flow = 1.6e-3;
    /// Time constant of the insertion valve, s.
    insertion_valve_time = 0.012;
    /// Pressure of the reducing valve, Pa.
    insertion_pressure = 80e5;
    /// Gain of the position controller, 1/s.
    insertion_gain = 12.0;
    /// Friction of the guide of the unit, N.
    insertion_friction = 400.0;

    /// Height by which the sleeper is lifted, m.
    lift_height = 0.020;
    /// Duration of the lift, s.
    lift_time = 0.15;
    /// Duration of the insertion, s.
    insertion_time = 0.35;
    /// Time after which the squeeze starts at any depth, s.
    insertion_limit = 0.60;
    /// Distance above full depth at which the squeeze starts, m.
    depth_tolerance = 0.008;
    /// Longest squeeze, s.
    squeeze_time = 0.80;
    /// Largest closing of a blade, m.
    closing_limit = 0.060;
    /// Duration of the hold, s.
    hold_time = 0.05;
    /// Duration of the withdrawal, s.
    withdrawal_time = 0.30;
}

impl Parameters {
    /// Returns the parameters with the cycle of `examples/machine/tamping.toml`.
    pub fn of_case() -> Self {
        Self { amplitude: 0.005, lift_height: 0.025, squeeze_time: 0.6, ..Self::default() }
    }

    /// Returns the area of a piston, m².
    pub fn piston_area(&self) -> f64 {
        0.25 * PI * self.bore * self.bore
    }

    /// Returns the area of the ring around the rod, m².
    pub fn rod_area(&self) -> f64 {
        0.25 * PI * (self.bore * self.bore - self.rod * self.rod)
    }

    /// Returns the eccentricity of the shaft that gives the amplitude at the blade, m.
    pub fn eccentricity(&self) -> f64 {
        self.amplitude * self.upper_length / self.lower_length
    }

    /// Returns the volumes of the chambers of a squeeze cylinder at half stroke, m³.
    pub fn chambers(&self) -> [f64; 2] {
        [self.piston_area(), self.rod_area()]
            .map(|area| self.line_volume + 0.5 * area * self.cylinder_stroke)
    }

    /// Returns the overlap by which the oil presses the open pistons onto their stops, m.
    pub fn seat(&self) -> f64 {
        self.supply_pressure * self.rod_area() / self.stop_stiffness
    }
}

//! Former names of keys and values. A case with one of them is refused with the present name.

/// Former and present paths of keys; a path matches from its end.
const KEYS: [(&str, &str); 27] = [
    ("bed.ballast_depth_m", "bed.sleeper_underside_z_m"),
    ("bed.grains.classes.share", "bed.grains.classes.number_fraction"),
    ("bed.grains.templates", "bed.grains.shape_count"),
    ("bed.preparation.rest_speed_m_per_s", "bed.preparation.settled_speed_m_per_s"),
    ("mount.about_x", "mount.rx"),
    ("mount.about_y", "mount.ry"),
    ("mount.about_z", "mount.rz"),
    ("mount.turning_stiffness_N_m_per_rad", "mount.rotational_stiffness_N_m_per_rad"),
    ("mount.turning_damping_N_m_s_per_rad", "mount.rotational_damping_N_m_s_per_rad"),
    ("tines.blade_m", "tines.blade_size_m"),
    ("tines.shaft_m", "tines.shaft_size_m"),
    ("tine.blade_m", "tine.blade_size_m"),
    ("tine.shaft_m", "tine.shaft_size_m"),
    ("tine.towards", "tine.squeeze_direction"),
    ("run.alert_m", "run.detection_distance_m"),
    ("run.output_every_s", "run.output_interval_s"),
    ("run.checkpoint_every_s", "run.checkpoint_interval_s"),
    ("solver.iterations", "solver.max_iterations"),
    ("solver.check_every", "solver.convergence_check_interval"),
    ("solver.warm_start", "solver.warm_start_factor"),
    ("solver.momentum", "solver.acceleration"),
    ("solver.boxes", "solver.partition.boxes"),
    ("solver.balanced", "solver.partition.subdomains"),
    ("solver.contacts_per_subdomain", "solver.partition.contacts_per_subdomain"),
    ("solver.recovery", "solver.penetration_correction"),
    ("solver.penetration_correction.share", "solver.penetration_correction.factor"),
    ("solver.penetration_correction.allowed_m", "solver.penetration_correction.slop_m"),
];

/// Former and present words of values.
const VALUES: [(&str, &str); 3] =
    [("held", "prescribed"), ("loaded", "free"), ("sprung", "spring")];

/// Returns the present path of the key that `path` named formerly.
pub fn key(path: &str) -> Option<String> {
    let path = without_indices(path);
    KEYS.iter().find_map(|(old, new)| {
        let before = path.strip_suffix(old)?;
        (before.is_empty() || before.ends_with('.')).then(|| format!("{before}{new}"))
    })
}

/// Returns the present word of the value that `word` was formerly.
pub fn value(word: &str) -> Option<&'static str> {
    VALUES.iter().find_map(|(old, new)| (*old == word).then_some(*new))
}

/// Returns `path` without the indices of its arrays.
pub fn without_indices(path: &str) -> String {
    path.split('.').map(|part| part.split('[').next().unwrap_or(part)).collect::<Vec<_>>().join(".")
}

//! Valid case files and their plans.

use crate::{BASE, changed};
use ballast::math::Vec3;
use ballast::model::{ContactStiffness, DofMode, DrivenBody, Grains, Model, Solver};
use ballast::track::TampingCycle;
use ballast::track::boundary::boundaries;
use ballast::track::plan::{Plan, TineShape};
use ballast::track::sleeper::sleeper;
use ballast::track::tine::tine;
use ballast_scenario::{content_key, read_case};

const EXAMPLES: [(&str, &str); 7] = [
    ("first", include_str!("../../../../examples/first.toml")),
    ("slice", include_str!("../../../../examples/slice.toml")),
    ("laptop", include_str!("../../../../examples/laptop.toml")),
    ("one_sleeper", include_str!("../../../../examples/one_sleeper.toml")),
    ("seven_sleepers", include_str!("../../../../examples/seven_sleepers.toml")),
    (
        "seven_sleepers_compliant",
        include_str!("../../../../examples/seven_sleepers_compliant.toml"),
    ),
    ("laptop_rigid", include_str!("../../../../benches/cases/laptop_rigid.toml")),
];

fn plan(text: &str) -> Plan {
    read_case(text, "case.toml").unwrap_or_else(|e| panic!("{e}")).plan
}

fn example(name: &str) -> Plan {
    let (_, text) = EXAMPLES.iter().find(|(n, _)| *n == name).expect(name);
    plan(text)
}

#[test]
fn the_examples_have_no_errors_and_no_warnings() {
    for (name, text) in EXAMPLES {
        let case = read_case(text, name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(case.plan.name, name);
        assert!(case.warnings.is_empty(), "{name}: {:?}", case.warnings);
        let [.., end] = case.plan.tamping.expect(name).ends();
        assert!((end - case.plan.run.duration_ns as f64 * 1e-9).abs() < 1e-9, "{name}: {end}");
    }
}

#[test]
fn the_cases_of_the_page_are_valid() {
    let page = include_str!("../../../../docs/src/guide/cases.md");
    let blocks = page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next());
    let mut cases: Vec<String> = Vec::new();
    for block in blocks {
        match cases.last() {
            _ if block.starts_with("name") => cases.push(block.into()),
            // Is added to the case before it.
            Some(case) if block.starts_with("[[sleeper]]") => cases.push(format!("{case}{block}")),
            _ => {}
        }
    }
    assert_eq!(cases.len(), 4);
    for text in &cases {
        let case = read_case(text, "docs/src/guide/cases.md").unwrap_or_else(|e| panic!("{e}"));
        assert!(case.warnings.is_empty(), "{:?}", case.warnings);
    }
}

#[test]
fn examples_have_the_steps_of_the_study() {
    let steps = |p: &Plan| p.run.duration_ns / p.run.stepping.step_ns;
    let seven = example("seven_sleepers");
    assert_eq!((seven.run.stepping.step_ns, steps(&seven)), (200_000, 8820));
    let solver = &seven.run.solver;
    assert_eq!(solver.max_iterations * solver.subdomain_sweeps, 740);
    assert_eq!(solver.interface_sweeps, solver.subdomain_sweeps);
    assert_eq!((solver.tolerance, solver.penetration_correction), (None, None));
    let one = example("one_sleeper");
    assert_eq!(one.run.solver.tolerance, None);
    assert!(one.run.solver.penetration_correction.is_some());
    assert_eq!((one.run.stepping.step_ns, steps(&one)), (800_000, 2272));
    let laptop = example("laptop_rigid");
    assert_eq!(steps(&laptop), 2205);
    assert_eq!(laptop.run.solver.tolerance, Some(1.666e-4));
    assert!(laptop.run.solver.penetration_correction.is_some());
}

#[test]
fn the_compliant_seven_sleepers_differ_by_contacts_step_and_solver() {
    let rigid = example("seven_sleepers");
    let mut compliant = example("seven_sleepers_compliant");
    assert_ne!(compliant.bed.stiffness, rigid.bed.stiffness);
    assert!(compliant.run.solver.tolerance.is_some());
    compliant.name = rigid.name.clone();
    compliant.bed.stiffness = rigid.bed.stiffness;
    compliant.run = rigid.run;
    assert_eq!(compliant, rigid);
}

#[test]
fn a_row_of_sleepers_is_expanded() {
    let seven = example("seven_sleepers");
    assert_eq!(seven.sleepers.len(), 7);
    let tamped: Vec<&str> =
        seven.sleepers.iter().filter(|s| s.tamped).map(|s| s.name.as_str()).collect();
    assert_eq!(tamped, ["sleeper_4"]);
    // The row stands in the middle of 3.6 m, at 0.514 m from one to the next.
    assert!((seven.sleepers[0].centre[0] - 0.258).abs() < 1e-12);
    assert!((seven.sleepers[3].centre[0] - 1.8).abs() < 1e-12);
    assert_eq!(seven.sleepers[3].centre[1], 1.0);
    assert_eq!(seven.sleepers[6].blocks[0].size, Vec3::new(0.29, 0.67, 0.21));
    assert_eq!(seven.bed.preparation.fill_level, 0.53);
}

#[test]
fn sleepers_have_the_modes_of_their_mount() {
    let mount = "tamped = [1]\nmount = { mass_kg = 300, z = \"spring\", stiffness_N_per_m = 2e7, \
                 ry = \"free\" }";
    let text = changed("tamped = [1]", mount);
    let found = plan(&text).sleepers[0].mount.expect("a mount");
    assert_eq!(found.mass, 300.0);
    assert_eq!(found.centre, Vec3::new(0.0, 0.0, 0.075));
    let (held, sprung) = (DofMode::Prescribed, DofMode::Spring { stiffness: 2e7, damping: 0.0 });
    assert_eq!(found.dof_modes, [held, held, sprung, held, DofMode::Free, held]);
    assert_eq!(plan(BASE).sleepers[0].mount, None);
    assert_eq!(content_key(&plan(&text)), content_key(&plan(BASE)), "the bed is the same");
}

#[test]
fn rows_of_tines_face_each_other_over_the_tamped_sleeper() {
    let seven = example("seven_sleepers");
    assert_eq!(seven.tines.len(), 8);
    for pair in 0..4 {
        let tines: Vec<_> = seven.tines.iter().filter(|t| t.pair == pair).collect();
        let [a, b] = tines.as_slice() else { panic!("pair {pair} has {}", tines.len()) };
        assert_eq!((a.direction, b.direction), (1.0, -1.0));
        assert_eq!(a.position[1], b.position[1]);
        // Half a block, the gap, half a blade.
        let distance = 0.145 + 0.10 + 0.011;
        assert!((a.position[0] - (1.8 - distance)).abs() < 1e-12);
        assert!((b.position[0] - (1.8 + distance)).abs() < 1e-12);
    }
    assert_eq!(seven.tines[0].name, "tine_1_plus");
    assert_eq!(seven.tines[7].name, "tine_4_minus");
}

#[test]
fn single_sleepers_and_tines_add_to_the_rows() {
    let text = changed(
        "[tamping]",
        "[[sleeper]]\nname = \"short\"\nx_m = 0.3\ny_m = 0.06\n\
         blocks = [{ size_m = [0.1, 0.1, 0.1] }]\n\
         [[tine]]\nname = \"lone\"\nx_m = 0.3\ny_m = 0.63\nsqueeze_direction = \"-x\"\npair = 7\n[tamping]",
    );
    let plan = plan(&text);
    assert_eq!(plan.sleepers[1].name, "short");
    assert!(!plan.sleepers[1].tamped);
    let lone = &plan.tines[4];
    assert_eq!((lone.name.as_str(), lone.direction, lone.pair), ("lone", -1.0, 7));
    let (blade, shaft) = (Vec3::new(0.022, 0.12, 0.07), Vec3::new(0.03, 0.06, 0.45));
    assert_eq!(lone.shape, TineShape::Boxes { blade, shaft });
}

#[test]
fn absent_keys_have_the_documented_defaults() {
    let text = "name = \"x\"\n[bed]\nsize_m = [1, 1, 1]\nsleeper_underside_z_m = 0.3\n\
                [run]\nduration_s = 0.1\n";
    let plan = plan(text);
    assert_eq!(plan.bed.seed, 1);
    assert_eq!((plan.bed.density, plan.bed.gravity), (2700.0, 9.81));
    assert_eq!(plan.bed.preparation.fill_level, 0.3);
    assert_eq!(plan.bed.friction.boundary, [0.8; 5]);
    assert_eq!(plan.bed.grains.classes.len(), 3);
    assert!(plan.sleepers.is_empty() && plan.tines.is_empty() && plan.tamping.is_none());
    let run = plan.run;
    assert_eq!((run.stepping.step_ns, run.stepping.theta), (200_000, 0.5));
    assert_eq!((run.output_ns, run.checkpoint_ns), (10_000_000, 0));
    assert_eq!(run.solver, Solver::default(), "as the core's");
}

#[test]
fn a_tolerance_of_zero_is_none() {
    let tolerance = |text| plan(&changed("tolerance = 1.666e-4", text)).run.solver.tolerance;
    assert_eq!(tolerance("tolerance = 1e-3"), Some(1e-3));
    assert_eq!(tolerance(""), Solver::default().tolerance);
    assert!(tolerance("").is_some());
    for none in ["tolerance = 0", "tolerance = 0.0", "tolerance = -0.0"] {
        assert_eq!(tolerance(none), None, "{none}");
    }
}

#[test]
fn times_are_exact_nanoseconds() {
    for (step, ns) in [("2e-4", 200_000), ("8e-4", 800_000), ("1e-9", 1), ("0.000_3", 300_000)] {
        let mut text = changed("duration_s = 1.764", "duration_s = 2.4")
            .replace("step_s = 8e-4", &format!("step_s = {step}"));
        if ns == 1 {
            // A period has 100 000 steps at most.
            text = text.replace(
                "frequency_Hz = 35, amplitude_m = 0.005",
                "frequency_Hz = 1e4, amplitude_m = 1e-9",
            );
        }
        assert_eq!(plan(&text).run.stepping.step_ns, ns, "{step}");
    }
    // The default distance of frames is a whole number of steps, too.
    assert_eq!(plan(BASE).run.output_ns, 10_400_000);
}

#[test]
fn the_force_limit_may_be_infinite() {
    let text = changed("force_limit_N = 7800", "force_limit_N = inf");
    assert_eq!(plan(&text).tamping.unwrap().squeeze.force_limit, f64::INFINITY);
}

#[test]
fn tines_that_squeeze_away_from_each_other_are_valid() {
    let tine = |name: &str, x: f64, towards: &str, pair: u32| {
        format!(
            "[[tine]]\nname = \"{name}\"\nx_m = {x}\ny_m = 0.07\nsqueeze_direction = \"{towards}\"\npair = {pair}\n"
        )
    };
    let both = tine("a", 0.10, "-x", 8) + &tine("b", 0.155, "+x", 9);
    plan(&changed("[tamping]", &format!("{both}[tamping]")));
}

#[test]
fn pairs_that_do_not_face_each_other_give_a_warning() {
    let warnings = |towards: [&str; 2]| {
        let tine = |name: &str, x: f64, towards: &str| {
            format!(
                "[[tine]]\nname = \"{name}\"\nx_m = {x}\ny_m = 0.07\nsqueeze_direction = \"{towards}\"\npair = 8\n"
            )
        };
        let both = tine("a", 0.10, towards[0]) + &tine("b", 0.40, towards[1]);
        let text = changed("[tamping]", &format!("{both}[tamping]"));
        let case = read_case(&text, "case.toml").unwrap_or_else(|e| panic!("{e}"));
        case.warnings.iter().map(|w| w.to_string()).collect::<String>()
    };
    assert_eq!(warnings(["+x", "-x"]), "");
    for towards in [["+x", "+x"], ["-x", "-x"], ["-x", "+x"]] {
        let text = warnings(towards);
        assert!(text.contains("two tines of pair 8 do not face"), "{towards:?}: {text}");
        assert!(text.contains(&format!("`b` at x = 0.4 m towards {}", towards[1])), "{text}");
    }
}

#[test]
fn a_range_of_shapes_may_begin_at_the_very_limit() {
    // As floating-point numbers 0.15 - 0.1 is below 0.05.
    plan(&changed("vertices = [8, 40]", "flatness = [0.15, 0.1]"));
}

#[test]
fn flat_grains_are_as_many_as_others_of_their_size() {
    // 4.3 million; sizes are those of spheres of equal volume.
    let text = changed("[0.60, 0.70, 0.45]", "[20, 22, 0.45]");
    plan(&text.replace("vertices = [8, 40]", "flatness = [0.4, 0.1]"));
}

#[test]
fn implausible_values_give_a_warning() {
    for (from, to, words) in [
        ("duration_s = 0.45", "duration_s = 0.2", "insertion is faster"),
        ("restitution = 0", "detection_distance_m = 0.01", "detected from very far"),
        ("\"synchronous\"", "\"sequential\"", "`partition` has no effect"),
        ("1.666e-4", "0\nnorm = \"quad\"", "`norm` has no effect"),
        ("1.666e-4", "0\nacceleration = \"nncg\"", "`acceleration` has no effect"),
        (
            "\"synchronous\"",
            "\"asynchronous\"\nacceleration = \"none\"",
            "`acceleration` has no effect",
        ),
        ("[tamping]", "[tamping]\nwithdrawal_s = 0.5", "during the withdrawal"),
        ("m3 = 2700", "m3 = 2700\ngravity_m_per_s2 = 0", "a bed without weight"),
        ("m3 = 2700", "m3 = 2700\ngravity_m_per_s2 = 981", "the gravity is not that of the Earth"),
        ("duration_s = 1.764", "duration_s = 904", "the withdrawal takes far longer"),
        ("restitution = 0", "output_interval_s = 4.0", "longer than the run"),
        ("restitution = 0", "checkpoint_interval_s = 4.0", "longer than the run"),
        ("0.45, depth_m = 0.018", "0.45, depth_m = -0.4", "never reaches the bed"),
        ("m3 = 2700", "m3 = 2.7", "2.7 kg/m³"),
        ("m3 = 2700", "m3 = 27000", "1000 to 8000 kg/m³"),
        ("1.666e-4", "1.0", "nearly unsolved"),
        ("frequency_Hz = 35", "frequency_Hz = 0.35", "slower than the squeeze"),
        ("[tines]", "[bed.friction]\nsleeper = 35\n[tines]", "at most 2"),
        ("step_s = 1e-3", "step_s = 1e-3\nfriction = 2.5", "at most 2"),
        ("= 0.06", "= 0.06\nmount = { rigid = true, mass_kg = 5 }", "`mass_kg` has no effect"),
        (
            "[sleepers]",
            "[sleepers]\nmount = { x = \"free\", stiffness_N_per_m = 1e7 }",
            "`stiffness_N_per_m` has no effect",
        ),
        ("= 0.06", "= 0.06\nmount = { stiffness_N_per_m = 745 }", "`tine_1_plus` is too soft"),
        ("force_limit_N = 7800", "force_limit_N = 7.8", "limits are in N"),
        ("0.45, depth_m", "0.45, force_limit_N = 5, depth_m", "the insertion pauses as soon as"),
        ("0.45, depth_m", "0.45, clearance_m = 0.016, depth_m", "may start among grains"),
    ] {
        let case = read_case(&changed(from, to), "case.toml").unwrap_or_else(|e| panic!("{e}"));
        let text: Vec<String> = case.warnings.iter().map(|w| w.to_string()).collect();
        assert!(text.iter().any(|w| w.contains(words)), "{to}: {text:?}");
    }
    assert!(read_case(BASE, "case.toml").unwrap().warnings.is_empty());
}

#[test]
fn a_time_step_far_too_long_for_contacts_gives_a_warning() {
    let (bed, rest) = BASE.split_once("[tamping]").unwrap();
    let (_, run) = rest.split_once("[run]").unwrap();
    let text = format!("{bed}[run]{run}").replace("step_s = 8e-4", "step_s = 6e-3");
    let case = read_case(&text, "case.toml").unwrap_or_else(|e| panic!("{e}"));
    let keys: Vec<&str> = case.warnings.iter().map(|w| w.key.as_str()).collect();
    assert!(keys.contains(&"run.step_s"), "{keys:?}");
}

/// Creates a model with the driven bodies of `plan` and without grains.
fn model_without_grains(plan: &Plan) -> Model {
    let mut shapes = Vec::new();
    let mut driven: Vec<_> =
        plan.tines.iter().map(|t| tine(t, plan.bed.friction.tine, &mut shapes).unwrap()).collect();
    let mut sleepers: Vec<_> = plan
        .sleepers
        .iter()
        .map(|s| DrivenBody {
            mount: s.mount,
            ..sleeper(s, plan.bed.friction.sleeper, &mut shapes).unwrap()
        })
        .collect();
    driven.extend(sleepers.extract_if(.., |s| s.mount.is_some()));
    driven.extend(boundaries(&plan.bed.size, plan.bed.friction.boundary));
    driven.append(&mut sleepers);
    Model {
        shapes,
        grains: Grains::default(),
        driven,
        gravity: Vec3::new(0.0, 0.0, -plan.bed.gravity),
        grain_friction: plan.bed.friction.grain,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: plan.run.restitution,
        stepping: plan.run.stepping,
        solver: plan.run.solver,
    }
}

#[test]
fn the_core_accepts_the_plans_of_the_reader() {
    let still = changed("amplitude_m = 0.005", "amplitude_m = 0").replace("= 8e-4", "= 4e-3");
    for (name, text) in EXAMPLES.into_iter().chain([("base", BASE), ("still", still.as_str())]) {
        let plan = plan(text);
        let model = model_without_grains(&plan);
        model.check().unwrap_or_else(|e| panic!("{name}: {e}"));
        let cycle = TampingCycle::new(&plan, &model).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(cycle.pairs().len() * 2, plan.tines.len(), "{name}");
        let end = plan.run.duration_ns as f64 * 1e-9;
        assert!((cycle.duration() - end).abs() < 1e-9, "{name}");
    }
}

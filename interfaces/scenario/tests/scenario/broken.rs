//! Broken case files: position and text of each error.

use crate::{BASE, changed};
use ballast_scenario::{CaseErrors, read_case};

/// Mark in a broken text of the position that the message must have.
const MARK: char = '«';

/// Text to replace in the base, its replacement with the mark, texts in the error at the mark.
struct Broken(&'static str, &'static str, &'static [&'static str]);

const TABLE: &[Broken] = &[
    // Syntax.
    Broken("step_s = 8e-4", "step_s = «8e-4 s", &["not TOML"]),
    Broken("[run]", "[run«", &["not TOML"]),
    Broken(
        "max_iterations = 300",
        "max_iterations = 300\n«max_iterations = 200",
        &["not TOML", "duplicate"],
    ),
    Broken("name = \"base\"", "name = \"base«", &["not TOML"]),
    Broken("step_s = 8e-4", "step_s = «0,0008", &["not TOML: decimal comma", "point: 0.0008"]),
    Broken(
        "step_s = 8e-4",
        "step_s = «0.8",
        &["the time step is too long for the grains", "from 0.4 m", "at most 0.1000 s"],
    ),
    Broken(
        "max_iterations = 300",
        "max_iterations = «0300",
        &["unexpected leading zero", "before it: 300"],
    ),
    Broken("name = \"base\"", "name = «base", &["not TOML", "a text in quotes: \"base\""]),
    // Keys.
    Broken("density_kg_per_m3", "«dencity_kg_per_m3", &["unknown key", "mean `density_kg_per_m3`"]),
    Broken("step_s = 8e-4", "«step = 8e-4", &["unknown key `step`", "did you mean `step_s`?"]),
    Broken(
        "duration_s = 1.764",
        "«durtion = 1.764",
        &["unknown key", "did you mean `duration_s`?"],
    ),
    Broken("[run]", "[bed.friction]\ngrain = «1e300\n[run]", &["out of range", "from 0 to 1000"]),
    Broken("tolerance", "«tolerence", &["unknown key", "did you mean `tolerance`?"]),
    Broken("stroke_m", "«stroke_mm", &["unknown key", "did you mean `stroke_m`?"]),
    Broken("[tamping]", "[«tampping]", &["unknown key", "did you mean `tamping`?"]),
    Broken("restitution = 0", "«seed = 3", &["unknown key", "`seed` belongs in `[bed]`"]),
    Broken(
        "density_kg_per_m3 = 2700",
        "«detection_distance_m = 1",
        &["`detection_distance_m` belongs in `[run]`"],
    ),
    Broken(
        "[bed]\nsize_m = [0.60, 0.70, 0.45]\n",
        "[«bed]\n",
        &["missing key `size_m`", "a list of 3"],
    ),
    Broken(
        "number_fraction = 0.3 }",
        "number_fraction = 0.2 }, «{ number_fraction = 0.1 }",
        &["missing key `size_m`"],
    ),
    // Types and values.
    Broken("= 2700", "= «\"2700 kg\"", &["wrong type", "text", "without quotes"]),
    Broken("[0.60, 0.70, 0.45]", "«[0.60, 0.70]", &["wrong number of entries", "list of 2"]),
    Broken("0.45]", "«true]", &["wrong type", "`true`", "a number from 0.0001 to 1000"]),
    Broken("\"synchronous\"", "«\"syncronous\"", &["unknown value", "did you mean `synchronous`?"]),
    Broken("max_iterations = 300", "max_iterations = «300.5", &["wrong type", "a whole number"]),
    Broken("[8, 40]", "[8, «101]", &["out of range", "from 4 to 100"]),
    Broken("[8, 40]", "«40", &["wrong type", "a list of 2"]),
    Broken("[run]", "«[[run]]", &["wrong type", "a list of 1", "a table"]),
    // Ranges.
    Broken("= 2700", "= «nan", &["out of range", "`nan`", "from 1 to 1000000", "kg/m³"]),
    Broken("= 2700", "= «1e300", &["out of range", "from 1 to 1000000"]),
    Broken("= 2700", "= «1e-300", &["out of range", "from 1 to 1000000"]),
    Broken("= 2700", "= «-2700", &["out of range", "a number from 1"]),
    Broken("= 0.28", "= «inf", &["out of range", "`inf`", "to 1000"]),
    Broken("gap_to_sleeper_m = 0.06", "gap_to_sleeper_m = «inf", &["not finite", "`inf`"]),
    Broken("max_iterations = 300", "max_iterations = «99999999999", &["is more than 4294967295"]),
    Broken("0.70, 0.45]", "«0.0, 0.45]", &["`size_m[1]` is out of range", "from 0.0001"]),
    Broken(
        "gap_to_sleeper_m",
        "blade_size_m = [«1e-300, 0.1, 0.07]\ngap_to_sleeper_m",
        &["`blade_size_m[0]` is out of range", "from 0.0001"],
    ),
    Broken("restitution = 0", "restitution = «1.5", &["out of range", "from 0 to 1"]),
    Broken("restitution = 0", "theta = «0.4", &["out of range", "from 0.5 to 1"]),
    Broken(
        "restitution = 0",
        "detection_distance_m = «0.06",
        &["very far away", "the largest grain, 0.05 m"],
    ),
    Broken("[tines]", "[tines]\nmount = { mass_kg = «1e31 }", &["from 0.001 to 1000000000"]),
    Broken("[tines]", "[tines]\nmount = { mass_kg = «1e-300 }", &["from 0.001 to 1000000000"]),
    Broken(
        "[tines]",
        "[tines]\nmount = { stiffness_N_per_m = «1e300 }",
        &["is more than 1000000000000000000"],
    ),
    Broken(
        "[tines]",
        "[tines]\nmount = { damping_ratio = «1e300 }",
        &["is more than 1000000000000000000"],
    ),
    Broken(
        "[bed.preparation]",
        "[bed.friction]\ngrain = «-0.1\n[bed.preparation]",
        &["from 0 to 1000"],
    ),
    Broken("max_iterations = 300", "max_iterations = «0", &["out of range", "1 or more"]),
    Broken("max_iterations = 300", "max_iterations = «-5", &["out of range", "`-5`"]),
    Broken("max_iterations = 300", "relaxation = «0", &["from 0.01 to 1"]),
    Broken("max_iterations = 300", "relaxation = «1.2", &["from 0.01 to 1"]),
    Broken(
        "max_iterations = 300",
        "penetration_correction = { factor = «0 }",
        &["above 0 and up to 1"],
    ),
    Broken("max_iterations = 300", "penetration_correction = { slop_m = «-1e-5 }", &["0 or more"]),
    Broken("max_iterations = 300", "penetration_correction = { iterations = «0 }", &["1 or more"]),
    Broken("max_iterations = 300", "penetration_correction = { «part = 0.1 }", &["`factor`"]),
    Broken("= 7800", "= «0", &["`force_limit_N` is out of range", "above 0"]),
    Broken("= 7800", "= «nan", &["out of range"]),
    Broken("= 7800", "= «1e-999", &["out of range"]),
    // The bed.
    Broken(
        "[{ size_m = 0.025, number_fraction = 0.7",
        "«[{ size_m = 0.025, number_fraction = 0.5",
        &["sum to 1", "0.8"],
    ),
    Broken("[8, 40]", "«[40, 8]", &["above its maximum", "write [8, 40]"]),
    Broken("vertices = [8, 40]", "elongation = «[0.95, 0.1]", &["grain shapes", "1.050"]),
    Broken("vertices = [8, 40]", "shape_count = «1", &["fewer shapes", "at least 2"]),
    Broken(
        "vertices = [8, 40]",
        "stones = [{ corners = «[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.1, 0.1, 0.1]] }]",
        &["no stone", "1 of 5", "ballast stones"],
    ),
    Broken(
        "vertices = [8, 40]",
        "vertices = «[8, 40]\nstones = [{ corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]] }]",
        &["given twice", "remove `vertices`"],
    ),
    Broken(
        "vertices = [8, 40]",
        "stones = [{ corners = «[[0, 0, 0], [1, 0, 0], [0, 1, 0]] }]",
        &["wrong number of entries", "stones[0].corners"],
    ),
    Broken("[0.60, 0.70, 0.45]", "«[600, 700, 450]", &["too large", "grains", "metres"]),
    Broken(
        "size_m = [0.60, 0.70, 0.45]",
        "size_m = «[0.05, 0.7, 0.45]",
        &["too small for one grain"],
    ),
    // Flat stones are wider than the sphere of their volume: by the cube root of 10 at a flatness of 0.1.
    Broken(
        "size_m = [0.60, 0.70, 0.45]\nsleeper_underside_z_m = 0.28\ndensity_kg_per_m3 = 2700\n\n[bed.grains]",
        "size_m = «[0.10, 0.70, 0.45]\nsleeper_underside_z_m = 0.28\n\n[bed.grains]\n\
         elongation = [1.0, 0.0]\nflatness = [0.1, 0.0]",
        &["too small for one grain", "the longest grain, 0.108 m"],
    ),
    Broken(
        "0.28\ndensity_kg_per_m3 = 2700\n\n[bed.grains]\nclasses = [{ size_m = 0.025, number_fraction = 0.7 }, \
         { size_m = 0.05, number_fraction = 0.3 }]\nvertices = [8, 40]\n\n[bed.preparation]",
        "«0.03\n[bed.preparation]\nfill_level_m = 0.04",
        &["the fill is too small for one grain", "the size of a grain, 0.050 m"],
    ),
    Broken(
        "size_m = [0.60, 0.70, 0.45]\nsleeper_underside_z_m = 0.28\ndensity_kg_per_m3 = 2700\n\n[bed.grains]\n\
         classes = [{ size_m = 0.025,",
        "size_m = «[0.60, 0.70, 0.45]\nsleeper_underside_z_m = 0.28\n\n[bed.grains]\n\
         classes = [{ size_m = 0.0005,",
        &["too wide for its smallest grains", "grains of 0.0005 m", "1.020e6 times the square"],
    ),
    Broken("= 0.28", "= «0.5", &["underside is above the box", "0.45 m"]),
    Broken("0.70, 0.45]", "0.70, «0.40]", &["fill level", "0.4 m", "highest block"]),
    Broken("step_s = 1e-3", "step_s = 1e-3\nfill_level_m = «0.2", &["fill level", "0.28 m"]),
    Broken("step_s = 1e-3", "step_s = «0.2", &["too large for pouring", "1 m/s"]),
    // Sleepers and tines.
    Broken("tamped = [1]", "tamped = [«2]", &["no sleeper has this number", "from 1 to 1"]),
    Broken("tamped = [1]", "tamped = [1, «1]", &["listed twice"]),
    Broken("tamped = [1]", "tamped = «[]", &["need a tamped sleeper"]),
    Broken("[sleepers]", "[«sleepers]\ncount = 2", &["missing key `pitch_m`"]),
    Broken("[sleepers]", "[sleepers]\nfirst_x_m = «0.1", &["outside the box", "0.1000 m"]),
    Broken("[sleepers]", "[sleepers]\ncount = 2\npitch_m = «0.2", &["`sleeper_2` overlaps"]),
    Broken("[sleepers]", "[sleepers]\ncount = «1001", &["out of range", "from 1 to 1000"]),
    Broken(
        "[{ size_m = [0.29, 0.40, 0.15] }]",
        "«[{ size_m = [0.29, 0.40, 0.15] }, { size_m = [0.2, 0.2, 0.1], offset_y_m = 0.1 }]",
        &["blocks of `sleeper_1` overlap"],
    ),
    Broken("[-0.1, 0.1]", "[-0.1, «0.3]", &["faces none of its blocks", "-0.200 to 0.200"]),
    Broken("[-0.1, 0.1]", "[0.0, «0.1]", &["overlap at the start", "tine_1_plus"]),
    Broken("= 0.06", "= «0.14", &["leaves the box", "at rest", "x = -0.0110 and 0.0190 m"]),
    Broken(
        "stroke_m = 0.05",
        "stroke_m = «35",
        &["leaves the box", "vibration and squeeze", "35.1040 m", "between 0 and 0.6 m"],
    ),
    Broken("amplitude_m = 0.005", "amplitude_m = «3", &["leaves the box", "with its vibration"]),
    Broken("= 0.06", "= «0.003", &["is inserted into `sleeper_1`"]),
    Broken(
        "amplitude_m = 0.005",
        "amplitude_m = «0.06",
        &["vibration drives", "less than 0.0560 m"],
    ),
    Broken("stroke_m = 0.05", "stroke_m = «0.06", &["drives `tine_1_plus`", "less than 0.0510 m"]),
    // At the end of the squeeze they are past each other.
    Broken(
        "[tamping]",
        "[[tine]]\nname = \"a\"\nx_m = 0.10\ny_m = 0.07\nsqueeze_direction = \"+x\"\npair = 8\n\
         [[tine]]\nname = \"b\"\nx_m = «0.155\ny_m = 0.07\nsqueeze_direction = \"-x\"\npair = 9\n[tamping]",
        &["drives `b` and `a` into each other", "gap of 0.0150 m", "at least 0.1000 m"],
    ),
    Broken(
        "[tamping]",
        "[[tine]]\nname = \"a b\"\nx_m = 0.08\ny_m = 0.05\nsqueeze_direction = «\"x\"\npair = 9\n[tamping]",
        &["unknown value", "\"+x\", \"-x\""],
    ),
    Broken(
        "[tines]",
        "[[sleeper]]\nname = «\"sleeper_1\"\nx_m = 0.3\ny_m = 0.06\n\
         blocks = [{ size_m = [0.1, 0.1, 0.1] }]\n[tines]",
        &["name is taken", "`sleeper_1`"],
    ),
    // A force column of one body would have the name of a position column of the other.
    Broken(
        "[tines]",
        "[[sleeper]]\nname = «\"sleeper_1_force\"\nx_m = 0.3\ny_m = 0.06\n\
         blocks = [{ size_m = [0.1, 0.1, 0.1] }]\n[tines]",
        &["columns of this name are taken", "`sleeper_1_force`", "more than `_force`"],
    ),
    Broken("\"base\"", "«\"a/b\"", &["cannot be used in files", "`a/b`"]),
    // Mounts of sleepers.
    Broken("tamped = [1]", "tamped = [1]\nmount = { z = «\"free\" }", &["the lift cannot move"]),
    Broken("tamped = [1]", "tamped = [1]\n«mount = { }", &["unsupported combination", "0 degrees"]),
    Broken(
        "tamped = [1]",
        "tamped = [1]\n«mount = { z = \"spring\" }",
        &["missing key `stiffness_N_per_m`"],
    ),
    Broken(
        "tamped = [1]",
        "tamped = [1]\nmount = { z = «\"fixed\" }",
        &["unknown value", "\"prescribed\", \"free\""],
    ),
    // The machine.
    Broken("depth_m = 0.018", "depth_m = «0.24", &["reaches the floor", "below 0.2300 m"]),
    Broken("duration_s = 1.764", "duration_s = «1.2", &["before the tines are withdrawn", "1.55"]),
    Broken("frequency_Hz = 35", "frequency_Hz = «140", &["8.9 steps per period", "at least 10"]),
    Broken(
        "frequency_Hz = 35",
        "frequency_Hz = «0.001",
        &["1250000 steps per period", "at most 100000"],
    ),
    // What does not vibrate has no period: forces are averaged over a part of the squeeze.
    Broken(
        "squeeze = { stroke_m = 0.05, force_limit_N = 7800 }\nvibration = { frequency_Hz = 35, \
         amplitude_m = 0.005 }\n\n[run]\nduration_s = 1.764\nstep_s = 8e-4",
        "squeeze = { stroke_m = 0.05, force_limit_N = 7800, duration_s = «0.4 }\n\
         vibration = { frequency_Hz = 0.001, amplitude_m = 0 }\n\n[run]\nduration_s = 1.764\nstep_s = 1e-7",
        &["too small for the squeeze", "400000 steps in a tenth of it", "at most 100000"],
    ),
    // The machine asks for it without tines, too.
    Broken(
        "[tines]\ny_offsets_m = [-0.1, 0.1]\ngap_to_sleeper_m = 0.06\n\n[tamping]\n\
         insertion = { duration_s = 0.45, depth_m = 0.018 }\n\
         squeeze = { stroke_m = 0.05, force_limit_N = 7800 }\nvibration = { frequency_Hz = 35",
        "[tamping]\nvibration = { frequency_Hz = «0.001",
        &["1250000 steps per period", "at most 100000"],
    ),
    Broken(
        "= 0.45, d",
        "= «0.01, d",
        &["time step is too large", "half the smallest grain, 0.0125 m"],
    ),
    Broken(
        "0.45, depth_m = 0.018",
        "«0.45, depth_m = -10",
        &["time step is too large", "half the smallest grain"],
    ),
    Broken(
        "[tines]\ny_offsets_m = [-0.1, 0.1]\ngap_to_sleeper_m = 0.06\n\n[tamping]",
        "[tamping]\nlift = { height_m = 10, duration_s = «0.2 }",
        &["time step is too large", "93.750 m/s"],
    ),
    // 11.6 m/s down and 10.9 m/s to the side are slow enough alone, 15.6 m/s are for both together.
    Broken(
        "duration_s = 0.45, depth_m = 0.018 }\nsqueeze = { stroke_m = 0.05, force_limit_N = 7800 }\n\
         vibration = { frequency_Hz = 35, amplitude_m = 0.005 }",
        "duration_s = «0.0256, depth_m = 0.018 }\nsqueeze = { stroke_m = 0.02, force_limit_N = 7800 }\n\
         vibration = { frequency_Hz = 60, amplitude_m = 0.029 }",
        &["time step is too large", "the vibration included", "0.0127 m per step"],
    ),
    // Up by 0.238 m, open by 0.05 m in half the time; the vibration comes on top.
    Broken(
        "[tamping]",
        "[tamping]\nwithdrawal_s = «0.01",
        &["time step is too large", "32.710 m/s", "the vibration included"],
    ),
    Broken(
        "= 1.764",
        "= «1.56",
        &["time step is too large", "32.710 m/s", "the vibration included"],
    ),
    // Traffic.
    Broken(
        "[run]",
        "[bed.traffic]\ncycles = 3\nmax_load_N = 1e3\nmin_load_N = «2e3\nfrequency_Hz = 5\n[run]",
        &["the smallest load is not below the largest", "2000 N", "`max_load_N`, 1000 N"],
    ),
    Broken(
        "[tamping]",
        "[tamping.«traffic]\ncycles = 3\nmax_load_N = 1e3\nfrequency_Hz = 5\n[tamping]",
        &["no load moves `sleeper_1`", "`z = \"spring\"`"],
    ),
    // Time and solver.
    Broken("step_s = 8e-4", "step_s = «1.5e-9", &["whole number of nanoseconds"]),
    Broken("= 1.764", "= «1.8175", &["whole number of time steps", "1.8168 or 1.8176 s"]),
    Broken("restitution = 0", "output_interval_s = «0.01", &["whole number", "0.0096 or 0.0104 s"]),
    Broken("restitution = 0", "checkpoint_interval_s = «1e-4", &["whole number", "0.0008 s"]),
    Broken("1.666e-4", "«-1.666e-4", &["out of range", "0 or more", "0: always all iterations"]),
    Broken("1.666e-4", "«nan", &["out of range", "0 or more"]),
    Broken("1.666e-4", "«inf", &["not finite", "0 or more"]),
    Broken(
        "boxes = [2, 1, 1] }",
        "boxes = [2, 1, 1], subdomains = «4 }",
        &["contradicts the method \"boxes\"", "remove"],
    ),
    Broken(
        "[solver]\nschedule = \"synchronous\"\npartition = { method = \"boxes\", boxes = [2, 1, 1] }",
        "[solver.«partition]\nmethod = \"balanced\"\n[solver]",
        &["missing key `subdomains`", "`[solver.partition]`"],
    ),
    Broken("[2, 1, 1]", "«[1000, 1000, 1000]", &["too many subdomains"]),
];

/// Line and column of the mark, and the text without it.
fn unmark(text: &str) -> (usize, usize, String) {
    let at = text.find(MARK).expect("the broken text has a mark");
    let line = text[..at].matches('\n').count() + 1;
    let column = text[..at].rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    (line, column, text.replace(MARK, ""))
}

pub fn errors(text: &str) -> CaseErrors {
    read_case(text, "broken.toml").expect_err(text)
}

#[test]
fn every_broken_case_has_an_error_at_its_mark() {
    assert!(TABLE.len() > 30);
    let complaints: Vec<String> = TABLE.iter().filter_map(complaint).collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n\n"));
}

/// Returns a description of the wrong answer to one broken case, if it is wrong.
fn complaint(Broken(from, to, words): &Broken) -> Option<String> {
    let (line, column, text) = unmark(&changed(from, to));
    let Err(found) = read_case(&text, "broken.toml") else {
        return Some(format!("{to:?}: read without an error"));
    };
    let Some(here) = found.errors.iter().find(|e| (e.line, e.column) == (line, column)) else {
        return Some(format!("{to:?}: expected an error at {line}:{column}\n{found}"));
    };
    let message = here.to_string();
    let place = format!("broken.toml:{line}:{column}");
    let mut missing =
        words.iter().copied().chain([place.as_str()]).filter(|w| !message.contains(w));
    missing.next().map(|word| format!("{to:?}: no {word:?} in\n{message}"))
}

#[test]
fn all_errors_of_a_file_are_reported_in_its_order() {
    let text = BASE
        .replace("= 2700", "= -1")
        .replace("tolerance", "tolerence")
        .replace("= 0.28", "= \"deep\"")
        .replace("duration_s = 1.764", "")
        .replace("number_fraction = 0.3", "number_fraction = 0.4");
    let found = errors(&text);
    let keys: Vec<&str> = found.errors.iter().map(|e| e.key.as_str()).collect();
    let expected = [
        "bed.sleeper_underside_z_m",
        "bed.density_kg_per_m3",
        "run.duration_s",
        "solver.tolerence",
    ];
    assert_eq!(keys, expected);
    assert!(found.to_string().ends_with("4 errors in broken.toml"), "{found}");
    // What only shows when all keys can be read comes with the ranges.
    let text =
        BASE.replace("= 2700", "= -1").replace("number_fraction = 0.3", "number_fraction = 0.4");
    let keys: Vec<String> = errors(&text).errors.into_iter().map(|e| e.key).collect();
    assert_eq!(keys, ["bed.density_kg_per_m3", "bed.grains.classes"]);
}

#[test]
fn a_row_without_a_pitch_has_no_error_about_tamped_sleepers() {
    let keys: Vec<String> = errors(&changed("tamped = [1]", "tamped = [1]\ncount = 3"))
        .errors
        .into_iter()
        .map(|e| e.key)
        .collect();
    assert_eq!(keys, ["sleepers.pitch_m"]);
}

#[test]
fn the_line_is_shown_with_carets_under_the_place() {
    let text = changed("density_kg_per_m3 = 2700", "density_kg_per_m3 = -2700 # é");
    let message = errors(&text).to_string();
    let lines: Vec<&str> = message.lines().collect();
    let source = lines.iter().position(|l| l.starts_with("6 | ")).expect(&message);
    assert_eq!(lines[source], "6 | density_kg_per_m3 = -2700 # é");
    assert_eq!(lines[source + 1], "  |                     ^^^^^");
}

#[test]
fn an_error_has_fields_for_programs() {
    let text = changed("schedule = ", "schedule = \"parallel\" #");
    let found = errors(&text);
    let json = serde_json::to_value(&found.errors[0]).unwrap();
    assert_eq!(json["file"], "broken.toml");
    let line = BASE.lines().position(|l| l.starts_with("schedule")).unwrap() + 1;
    assert_eq!(json["line"], line);
    assert_eq!(json["column"], 12);
    assert_eq!(json["key"], "solver.schedule");
    assert_eq!(json["found"], "`\"parallel\"`");
    assert_eq!(json["expected"], "one of \"sequential\", \"synchronous\", \"asynchronous\"");
    assert_eq!(json["hint"], serde_json::Value::Null);
}

#[test]
fn an_empty_file_has_errors_for_all_required_keys() {
    let found = errors("");
    let keys: Vec<&str> = found.errors.iter().map(|e| e.key.as_str()).collect();
    assert_eq!(keys, ["name", "bed", "run"]);
}

#[test]
fn control_characters_of_a_file_do_not_reach_the_terminal() {
    let message = errors("name = \"\u{1b}[31m\"").to_string();
    assert!(!message.contains('\u{1b}'), "{message:?}");
}

#[test]
fn a_former_name_is_refused_with_the_present_one() {
    for (from, to, former, present) in [
        (
            "sleeper_underside_z_m",
            "ballast_depth_m",
            "bed.ballast_depth_m",
            "bed.sleeper_underside_z_m",
        ),
        (
            "number_fraction = 0.7",
            "share = 0.7",
            "bed.grains.classes.share",
            "bed.grains.classes.number_fraction",
        ),
        ("vertices = [8, 40]", "templates = 60", "bed.grains.templates", "bed.grains.shape_count"),
        (
            "step_s = 1e-3",
            "rest_speed_m_per_s = 5e-3",
            "bed.preparation.rest_speed_m_per_s",
            "bed.preparation.settled_speed_m_per_s",
        ),
        (
            "tamped = [1]",
            "tamped = [1]\nmount = { about_x = \"free\" }",
            "sleepers.mount.about_x",
            "sleepers.mount.rx",
        ),
        ("[tines]", "[tines]\nblade_m = [0.02, 0.1, 0.1]", "tines.blade_m", "tines.blade_size_m"),
        (
            "[tamping]",
            "[[tine]]\nname = \"a\"\nx_m = 0.1\ny_m = 0.1\ntowards = \"+x\"\npair = 9\n[tamping]",
            "tine.towards",
            "tine.squeeze_direction",
        ),
        ("restitution = 0", "alert_m = 1e-3", "run.alert_m", "run.detection_distance_m"),
        ("restitution = 0", "output_every_s = 0", "run.output_every_s", "run.output_interval_s"),
        ("max_iterations", "iterations", "solver.iterations", "solver.max_iterations"),
        ("tolerance", "boxes = [2, 1, 1]\ntolerance", "solver.boxes", "solver.partition.boxes"),
        ("tolerance", "momentum = false\ntolerance", "solver.momentum", "solver.acceleration"),
        (
            "tolerance",
            "recovery = { share = 0.1 }\ntolerance",
            "solver.recovery",
            "solver.penetration_correction",
        ),
        (
            "tolerance",
            "penetration_correction = { share = 0.1 }\ntolerance",
            "solver.penetration_correction.share",
            "solver.penetration_correction.factor",
        ),
    ] {
        let found = errors(&changed(from, to));
        assert_eq!(found.errors.len(), 1, "{found}");
        let message = found.to_string();
        assert!(message.contains(&format!("`{former}` is now `{present}`")), "{message}");
    }
    let message =
        errors(&changed("tamped = [1]", "tamped = [1]\nmount = { z = \"held\" }")).to_string();
    assert!(message.contains("`\"held\"` is now `\"prescribed\"`"), "{message}");
}

//! Solutions of problems as text, tables and performance profile.

use crate::files::csv_text;
use crate::table::{TextTable, figure};
use ballast::nlgs::solution::Solution;
use ballast_report::plot::{Chart, HtmlPage, SeriesStyle};
use serde_json::{Value, json};
use std::fmt::Write;

/// Solution of one problem to one tolerance with one method.
#[derive(Debug, Clone)]
pub struct SolveRow {
    pub problem: String,
    pub contacts: usize,
    pub method: String,
    /// Tolerance of the error ‖F‖/‖q‖.
    pub tolerance: f64,
    pub solution: Solution,
    /// CPU time of the solution, s.
    pub seconds: f64,
}

impl SolveRow {
    /// Returns the row as the fields of an event.
    pub fn json(&self) -> Value {
        let errors = &self.solution.errors;
        json!({
            "problem": self.problem,
            "contacts": self.contacts,
            "method": self.method,
            "tolerance": self.tolerance,
            "converged": self.solution.converged,
            "sweeps": self.solution.sweeps,
            "newton_steps": self.solution.newton_steps,
            "cpu_s": self.seconds,
            "errors": {
                "abh": errors.abh, "siconos": errors.siconos, "fclib": errors.fclib,
                "unit_free": errors.unit_free,
            },
        })
    }
}

/// Returns all figures of one solution as text.
pub fn report(row: &SolveRow) -> String {
    let Solution { errors, sweeps, newton_steps, converged, .. } = &row.solution;
    let outcome = if *converged { "solved" } else { "NOT solved" };
    let mut text = format!("{}: {} contacts, {outcome}\n", row.problem, row.contacts);
    let mut line = |label: &str, value: String, note: &str| {
        let _ = writeln!(text, "  {}", format!("{label:<14}{value:>10}  {note}").trim_end());
    };
    line("sweeps", sweeps.to_string(), &format!("method {}", row.method));
    line("Newton steps", newton_steps.to_string(), "");
    line("CPU time", figure(row.seconds, 3), "s");
    let note = format!("‖F‖/‖q‖ (Acary, Brémond, Huber); tolerance {:e}", row.tolerance);
    line("error ABH", exponent(errors.abh), &note);
    line("error Siconos", exponent(errors.siconos), "‖F‖/max(‖q‖, ‖r‖, ‖u‖)");
    line("error FCLIB", exponent(errors.fclib), "‖F‖/(1 + sqrt ‖q‖)");
    line("unit-free", exponent(errors.unit_free), "‖F‖/‖r‖ with ρ = 3/tr W_cc");
    text.trim_end().to_string()
}

fn exponent(value: f64) -> String {
    format!("{value:.2e}")
}

/// Returns the table of all solutions as text.
pub fn table(rows: &[SolveRow]) -> String {
    lines(rows).text().trim_end().to_string()
}

/// Returns the table of all solutions.
fn lines(rows: &[SolveRow]) -> TextTable {
    let header = [
        "contacts",
        "method",
        "tolerance",
        "solved",
        "sweeps",
        "Newton",
        "CPU s",
        "ABH",
        "Siconos",
        "FCLIB",
        "unit-free",
    ];
    let mut table = TextTable::new("problem", header);
    for row in rows {
        let Solution { errors, .. } = &row.solution;
        table.row([
            row.problem.clone(),
            row.contacts.to_string(),
            row.method.clone(),
            format!("{:e}", row.tolerance),
            if row.solution.converged { "yes" } else { "no" }.to_string(),
            row.solution.sweeps.to_string(),
            row.solution.newton_steps.to_string(),
            format!("{:.4}", row.seconds),
            exponent(errors.abh),
            exponent(errors.siconos),
            exponent(errors.fclib),
            exponent(errors.unit_free),
        ]);
    }
    table
}

/// Returns the table of all solutions as CSV.
pub fn csv(rows: &[SolveRow]) -> String {
    let columns = [
        "problem",
        "contacts",
        "method",
        "tolerance",
        "solved",
        "sweeps",
        "newton_steps",
        "cpu_s",
        "abh",
        "siconos",
        "fclib",
        "unit_free",
    ];
    let cells = |row: &SolveRow| {
        let Solution { errors, converged, sweeps, newton_steps, .. } = &row.solution;
        [
            row.problem.clone(),
            row.contacts.to_string(),
            row.method.clone(),
            format!("{:e}", row.tolerance),
            converged.to_string(),
            sweeps.to_string(),
            newton_steps.to_string(),
            format!("{:.6}", row.seconds),
            format!("{:e}", errors.abh),
            format!("{:e}", errors.siconos),
            format!("{:e}", errors.fclib),
            format!("{:e}", errors.unit_free),
        ]
    };
    csv_text(&columns, rows.iter().map(cells))
}

/// Curve of a performance profile after Dolan and Moré.
#[derive(Debug, Clone, PartialEq)]
pub struct PerformanceProfile {
    pub tolerance: f64,
    pub method: String,
    /// Factors over the CPU time of the fastest method, ascending, each with the fraction of problems solved within it.
    pub points: Vec<[f64; 2]>,
}

/// Returns the performance profile of each method at each tolerance.
pub fn performance_profile(rows: &[SolveRow]) -> Vec<PerformanceProfile> {
    let mut profiles = Vec::new();
    for tolerance in distinct(rows.iter().map(|r| r.tolerance)) {
        let of_tolerance: Vec<&SolveRow> =
            rows.iter().filter(|r| r.tolerance == tolerance).collect();
        let problems = distinct(of_tolerance.iter().map(|r| r.problem.as_str()));
        for method in distinct(of_tolerance.iter().map(|r| r.method.as_str())) {
            let mut factors: Vec<f64> = (problems.iter())
                .filter_map(|&problem| factor(&of_tolerance, problem, method))
                .collect();
            factors.sort_by(f64::total_cmp);
            let fraction = |k: usize| (k + 1) as f64 / problems.len() as f64;
            let points = factors.iter().enumerate().map(|(k, f)| [*f, fraction(k)]).collect();
            profiles.push(PerformanceProfile { tolerance, method: method.into(), points });
        }
    }
    profiles
}

/// Returns performance profiles as CSV.
pub fn profile_csv(profiles: &[PerformanceProfile]) -> String {
    let rows = profiles.iter().flat_map(|PerformanceProfile { tolerance, method, points }| {
        let without_points = points.is_empty().then_some([1.0, 0.0]);
        points.iter().copied().chain(without_points).map(move |[factor, fraction]| {
            let tolerance = format!("{tolerance:e}");
            [tolerance, method.clone(), format!("{factor:.4}"), format!("{fraction:.4}")]
        })
    });
    csv_text(&["tolerance", "method", "factor", "fraction"], rows)
}

/// Returns performance profiles as a page with curves and the table of all solutions.
pub fn profile_page(profiles: &[PerformanceProfile], rows: &[SolveRow]) -> String {
    let mut page = HtmlPage::new("Friction-contact problems: performance profile");
    page.text(
        "Fraction of problems that a method solves within a factor of the CPU time of the fastest one (Dolan and \
         Moré 2002). A curve that ends below 1 belongs to a method that does not solve all of them.",
    );
    let longest = profiles.iter().flat_map(|p| &p.points).map(|p| p[0]).fold(10.0, f64::max);
    for tolerance in distinct(profiles.iter().map(|p| p.tolerance)) {
        let title = format!("Solved to ‖F‖/‖q‖ <= {tolerance:e}");
        let (x, y) = ("factor over the fastest method", "fraction of the problems");
        let mut chart = Chart::new(&title, x, y).log_x().starting_at_zero();
        for profile in profiles.iter().filter(|p| p.tolerance == tolerance) {
            let mut points = profile.points.clone();
            // The curve is constant beyond the last solved problem.
            points.extend(profile.points.last().map(|last| [longest, last[1]]));
            chart = chart.with(&profile.method, points, SeriesStyle::Steps);
        }
        page.figure(&chart.svg());
    }
    page.table(&lines(rows));
    page.html()
}

/// Returns the time of `method` over the shortest time; `None` if it does not solve the problem.
fn factor(rows: &[&SolveRow], problem: &str, method: &str) -> Option<f64> {
    let solved = || rows.iter().filter(|r| r.problem == problem && r.solution.converged);
    // Resolution of the clock.
    let seconds = |r: &&SolveRow| r.seconds.max(1e-6);
    let own = solved().find(|r| r.method == method).map(seconds)?;
    let best = solved().map(seconds).fold(own, f64::min);
    Some(own / best)
}

/// Returns the distinct values in the order of their first occurrence.
fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut out = Vec::new();
    for value in values {
        if !out.contains(&value) {
            out.push(value);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast::nlgs::assembled_problem::NaturalMapErrors;

    fn row(problem: &str, method: &str, seconds: f64, converged: bool) -> SolveRow {
        let errors = NaturalMapErrors { abh: 5e-7, siconos: 4e-7, fclib: 3e-7, unit_free: 2e-7 };
        let solution = Solution { impulse: vec![], errors, converged, sweeps: 12, newton_steps: 3 };
        let (problem, method) = (problem.to_string(), method.to_string());
        SolveRow { problem, contacts: 7, method, tolerance: 1e-6, solution, seconds }
    }

    #[test]
    fn method_without_solutions_is_in_the_profile() {
        let rows = [row("a", "nlgs", 3.0, false), row("a", "auto", 1.0, true)];
        let csv = profile_csv(&performance_profile(&rows));
        assert_eq!(csv.lines().nth(1), Some("1e-6,nlgs,1.0000,0.0000"), "{csv}");
    }

    #[test]
    fn profile_counts_problems_solved_within_a_factor() {
        let rows = [
            row("a", "nlgs", 3.0, true),
            row("a", "auto", 1.0, true),
            row("b", "nlgs", 2.0, false),
            row("b", "auto", 4.0, true),
        ];
        let profiles = performance_profile(&rows);
        assert_eq!(
            profile_csv(&profiles),
            "tolerance,method,factor,fraction\n\
             1e-6,nlgs,3.0000,0.5000\n\
             1e-6,auto,1.0000,0.5000\n\
             1e-6,auto,1.0000,1.0000\n"
        );
        let page = profile_page(&profiles, &rows);
        assert!(page.contains("within a factor") && page.contains("nlgs") && page.contains("<svg"));
        // Half of the problems, from three times the time of the fastest on, and no more.
        let [_, nlgs_and_auto] = &page.split("<g ").collect::<Vec<_>>()[..] else {
            panic!("{page}")
        };
        let curves: Vec<&str> =
            nlgs_and_auto.split("<path d=\"M").filter(|c| c.contains("line c")).collect();
        assert_eq!(curves.len(), 2, "{page}");
        assert!(curves.iter().all(|c| c.contains('H') && !c.contains("NaN")), "{curves:?}");
    }

    #[test]
    fn tables_have_one_line_per_solution() {
        let rows = [row("a,b", "auto", 1.0, true), row("c", "auto", 0.5, false)];
        let lines: Vec<String> = csv(&rows).lines().map(str::to_string).collect();
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[1], "\"a,b\",7,auto,1e-6,true,12,3,1.000000,5e-7,4e-7,3e-7,2e-7");
        assert_eq!([lines[0].matches(',').count(), lines[2].matches(',').count()], [11; 2]);
        let text = table(&rows);
        assert!(text.contains("Siconos") && text.lines().count() == 3, "{text}");
        assert!(report(&rows[1]).contains("NOT solved") && report(&rows[0]).contains("5.00e-7"));
    }
}

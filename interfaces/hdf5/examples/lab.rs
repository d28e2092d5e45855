use ballast::nlgs::solution::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let tol: f64 = a[1].parse().unwrap();
    let max: u64 = a[2].parse().unwrap();
    let method = match a[3].as_str() { "nlgs" => Method::Nlgs, _ => Method::Auto };
    for f in &a[4..] {
        let p = match ballast_hdf5::fclib::read(f) { Ok(p) => p, Err(e) => { println!("{e}"); continue } };
        let t = std::time::Instant::now();
        let s = solve(&p.local, None, &Settings { method, tolerance: tol, max_sweeps: max });
        println!("{:45} nc {:4} sweeps {:6} newton {:4} {:8.4}s abh {:.2e} sic {:.2e} uf {:.2e}", f.rsplit('/').next().unwrap(), p.local.contact_count(), s.sweeps, s.newton_steps, t.elapsed().as_secs_f64(), s.errors.abh, s.errors.siconos, s.errors.unit_free);
    }
}

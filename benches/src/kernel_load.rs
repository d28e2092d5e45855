//! Contact sets that `ballast bench kernel` sweeps: lattices of grains as one set or in subdomains.

use super::result_sheet::ResultSheet;
use super::roofline::Rate;
use ballast::lanes::InstructionSet;
use ballast::model::PartitionRule;
use ballast::nlgs::lattice_scene::LatticeScene;
use ballast::nlgs::{ContactSet, MemoryTraffic, OperationCounts};
use ballast::partition::Partition;
use ballast_session::lock::enter;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::sync::Mutex;

/// Smaller lattices: sets that fit a first cache, a second cache, and one of some 16 000 contacts.
const LATTICES: [[usize; 3]; 3] = [[3, 3, 4], [10, 10, 8], [16, 16, 14]];
/// Contacts of a subdomain, which fits a second cache.
const CONTACTS_PER_SUBDOMAIN: u32 = 4000;
/// Sweeps before the measurement; in the first ones more contacts slip.
const WARM_UP_SWEEPS: usize = 20;

/// Contact sets of a measurement, with bytes and operations of a sweep by one thread, or over all subdomains.
pub struct KernelLoad {
    pub lattice: String,
    pub divided: bool,
    /// One copy per thread, or one set per subdomain.
    pub sets: Vec<Mutex<ContactSet>>,
    pub contacts: usize,
    pub traffic: MemoryTraffic,
    pub operations: OperationCounts,
}

impl KernelLoad {
    pub fn form(&self) -> &'static str {
        if self.divided { "subdomains" } else { "one set per thread" }
    }

    fn new(lattice: String, divided: bool, sets: Vec<ContactSet>) -> Self {
        let counted = if divided { &sets[..] } else { &sets[..1] };
        let (mut traffic, mut operations) = (MemoryTraffic::default(), OperationCounts::default());
        for set in counted {
            traffic += set.traffic();
            operations += set.operations(1.0);
        }
        let contacts = counted.iter().map(ContactSet::contact_count).sum();
        let sets = sets.into_iter().map(Mutex::new).collect();
        Self { lattice, divided, sets, contacts, traffic, operations }
    }

    /// Returns the number of contacts that a sweep on `threads` threads visits.
    pub fn visits(&self, threads: usize) -> usize {
        if self.divided { self.contacts } else { threads * self.contacts }
    }

    /// Returns the number of bytes per thread.
    pub fn bytes_per_thread(&self, threads: usize) -> usize {
        if self.divided { self.traffic.footprint / threads } else { self.traffic.footprint }
    }

    /// Measures the visits per second.
    pub fn rate(&self, instructions: InstructionSet, pool: &ThreadPool, seconds: f64) -> Rate {
        self.sets.iter().for_each(|set| enter(set).set_arithmetic(instructions));
        let threads = pool.current_num_threads();
        let rate = Rate::measure(seconds, threads, |times| {
            if self.divided {
                for _ in 0..times {
                    pool.install(|| {
                        self.sets.par_iter().with_max_len(1).for_each(|set| enter(set).sweep(1.0));
                    });
                }
                return;
            }
            pool.broadcast(|thread| {
                let mut set = enter(&self.sets[thread.index()]);
                for _ in 0..times {
                    set.sweep(1.0);
                }
            });
        });
        rate.times(self.visits(threads) as f64)
    }
}

/// Creates the contact sets: smaller lattices and the largest as one set each, then the largest in subdomains.
pub fn kernel_loads(edge: usize, threads: usize, sheet: &mut ResultSheet) -> Vec<KernelLoad> {
    let largest = [edge; 3];
    let grains = |size: &[usize; 3]| size.iter().product::<usize>();
    let below = LATTICES.into_iter().filter(|size| grains(size) < grains(&largest));
    let name = |[x, y, z]: [usize; 3]| format!("{x} x {y} x {z} grains");
    let mut loads: Vec<KernelLoad> = below
        .map(|size| {
            let set = whole(&LatticeScene::grid(size, 1, 0.0, 13));
            KernelLoad::new(name(size), false, vec![set; threads])
        })
        .collect();
    let scene = LatticeScene::grid(largest, 1, 0.0, 13);
    loads.push(KernelLoad::new(name(largest), false, vec![whole(&scene)]));
    let sets = subdomains(&scene);
    let (number, all) = (sets.len(), scene.contacts.len());
    let divided = KernelLoad::new(name(largest), true, sets);
    sheet.note(
        "subdomains",
        format!(
            "{number} of about {CONTACTS_PER_SUBDOMAIN} contacts; {:.1} % of {all} contacts lie between them and are not swept",
            100.0 * (1.0 - divided.contacts as f64 / all as f64)
        ),
    );
    loads.push(divided);
    loads
}

/// Packs all contacts of a scene into one set.
fn whole(scene: &LatticeScene) -> ContactSet {
    let contacts: Vec<u32> = (0..scene.problem.contacts.len() as u32).collect();
    let grains: Vec<u32> = (0..scene.problem.body_count() as u32).collect();
    packed(scene, &contacts, &grains, &grains)
}

/// Packs the subdomains of a scene, without the contacts between them.
fn subdomains(scene: &LatticeScene) -> Vec<ContactSet> {
    let mut partition = Partition::default();
    let positions = &scene.state.position[..scene.model.grains.len()];
    partition.divide(
        PartitionRule::ContactsPer(CONTACTS_PER_SUBDOMAIN),
        positions,
        &scene.contacts,
    );
    let mut line_of = vec![0; positions.len()];
    (0..partition.grains.len())
        .map(|s| {
            let grains = partition.grains.list(s);
            for (line, &grain) in (0..).zip(grains) {
                line_of[grain as usize] = line;
            }
            packed(scene, partition.contacts.list(s), grains, &line_of)
        })
        .collect()
}

/// Packs contacts into a set and sweeps it a few times.
fn packed(scene: &LatticeScene, contacts: &[u32], grains: &[u32], line_of: &[u32]) -> ContactSet {
    let mut set = ContactSet::default();
    set.pack(&scene.problem, contacts, grains.len(), |grain| line_of[grain as usize]);
    for (line, &grain) in set.lines.iter_mut().zip(grains) {
        *line = scene.problem.lines[grain as usize];
    }
    set.apply_impulses();
    (0..WARM_UP_SWEEPS).for_each(|_| set.sweep(1.0));
    set
}

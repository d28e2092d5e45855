//! What `ballast bench kernel` sweeps: lattices of grains as one set, or in subdomains.

use super::roof::Rate;
use super::sheet::Sheet;
use ballast::lanes::InstructionSet;
use ballast::model::PartitionRule;
use ballast::nlgs::lattice_scene::LatticeScene;
use ballast::nlgs::{ContactSet, MemoryTraffic, OperationCounts};
use ballast::partition::Partition;
use ballast_session::lock::enter;
use rayon::ThreadPool;
use rayon::prelude::*;
use std::sync::Mutex;

/// Lattices below the largest: sets for a first cache, a second cache, and of some 16 000 contacts.
const LATTICES: [[usize; 3]; 3] = [[3, 3, 4], [10, 10, 8], [16, 16, 14]];
/// Contacts of a subdomain: it fits a second cache.
const PER_SUBDOMAIN: u32 = 4000;
/// Sweeps before anything is measured: the first ones have more contacts that slip.
const SETTLING: usize = 20;

/// Sets that are swept, and what a sweep over one thread's share (or all subdomains) is.
pub struct Load {
    pub lattice: String,
    pub divided: bool,
    /// A copy per thread, or subdomains.
    pub sets: Vec<Mutex<ContactSet>>,
    pub contacts: usize,
    pub traffic: MemoryTraffic,
    pub operations: OperationCounts,
}

impl Load {
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

    /// Contacts that a sweep on some threads visits.
    pub fn visits(&self, threads: usize) -> usize {
        if self.divided { self.contacts } else { threads * self.contacts }
    }

    /// Bytes that each of some threads has to do with.
    pub fn bytes_each(&self, threads: usize) -> usize {
        if self.divided { self.traffic.footprint / threads } else { self.traffic.footprint }
    }

    /// Visits per second.
    pub fn rate(&self, arithmetic: InstructionSet, pool: &ThreadPool, seconds: f64) -> Rate {
        self.sets.iter().for_each(|set| enter(set).set_arithmetic(arithmetic));
        let threads = pool.current_num_threads();
        let rate = Rate::of(seconds, threads, |times| {
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

/// The sets to sweep: lattices below the largest and the largest as they are, then the largest in subdomains.
pub fn loads(edge: usize, threads: usize, sheet: &mut Sheet) -> Vec<Load> {
    let largest = [edge; 3];
    let grains = |size: &[usize; 3]| size.iter().product::<usize>();
    let below = LATTICES.into_iter().filter(|size| grains(size) < grains(&largest));
    let name = |[x, y, z]: [usize; 3]| format!("{x} x {y} x {z} grains");
    let mut loads: Vec<Load> = below
        .map(|size| {
            let set = whole(&LatticeScene::grid(size, 1, 0.0, 13));
            Load::new(name(size), false, vec![set; threads])
        })
        .collect();
    let scene = LatticeScene::grid(largest, 1, 0.0, 13);
    loads.push(Load::new(name(largest), false, vec![whole(&scene)]));
    let sets = subdomains(&scene);
    let (number, all) = (sets.len(), scene.contacts.len());
    let divided = Load::new(name(largest), true, sets);
    sheet.note(
        "subdomains",
        format!(
            "{number} of about {PER_SUBDOMAIN} contacts; {:.1} % of {all} contacts lie between them and are not swept",
            100.0 * (1.0 - divided.contacts as f64 / all as f64)
        ),
    );
    loads.push(divided);
    loads
}

/// All contacts of a scene as one set.
fn whole(scene: &LatticeScene) -> ContactSet {
    let contacts: Vec<u32> = (0..scene.problem.contacts.len() as u32).collect();
    let grains: Vec<u32> = (0..scene.problem.body_count() as u32).collect();
    packed(scene, &contacts, &grains, &grains)
}

/// The subdomains of a scene, without what lies between them.
fn subdomains(scene: &LatticeScene) -> Vec<ContactSet> {
    let mut partition = Partition::default();
    let positions = &scene.state.position[..scene.model.grains.len()];
    partition.divide(PartitionRule::ContactsPer(PER_SUBDOMAIN), positions, &scene.contacts);
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

/// A set that was swept a few times.
fn packed(scene: &LatticeScene, contacts: &[u32], grains: &[u32], line_of: &[u32]) -> ContactSet {
    let mut set = ContactSet::default();
    set.pack(&scene.problem, contacts, grains.len(), |grain| line_of[grain as usize]);
    for (line, &grain) in set.lines.iter_mut().zip(grains) {
        *line = scene.problem.lines[grain as usize];
    }
    set.apply_impulses();
    (0..SETTLING).for_each(|_| set.sweep(1.0));
    set
}

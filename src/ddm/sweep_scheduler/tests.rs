use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::ThreadPoolBuilder;

/// Returns a random interface of subdomains, of which each two touch with a probability.
fn interface(subdomains: usize, probability: f64, seed: u64) -> Interface {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut touching = Vec::new();
    for b in 0..subdomains as u32 {
        for a in (0..b).filter(|_| rng.random_bool(probability)).collect::<Vec<_>>() {
            touching.extend((0..rng.random_range(1..5u32)).map(|_| [a, b]));
        }
    }
    let mut interface = Interface::default();
    touching.sort_unstable();
    interface.group(subdomains, &touching.into_iter().zip(0..).collect::<Vec<_>>());
    interface
}

/// Returns the subdomains that a task uses exclusively.
fn needs(interface: &Interface, task: &SweepTask) -> Vec<u32> {
    match task.set.checked_sub(interface.groups_by_subdomain.len()) {
        None => vec![task.set as u32],
        Some(g) => interface.pairs[g].to_vec(),
    }
}

/// Returns one batch.
fn once(passes: u32) -> impl FnMut() -> Option<PassBatch<()>> + Send {
    let mut batch = Some(PassBatch { passes, plan: () });
    move || batch.take()
}

/// Returns all tasks of a run in an order in which they ended; passes are counted through its batches.
fn record(interface: &Interface, passes: u32, threads: usize, seed: u64) -> Vec<SweepTask> {
    let seen = Mutex::new(Vec::new());
    let taken: Vec<AtomicBool> =
        interface.groups_by_subdomain.starts[1..].iter().map(|_| AtomicBool::new(false)).collect();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut scheduler = SweepScheduler::default();
    // A second run starts with the affinity of the first.
    for _ in 0..2 {
        seen.lock().unwrap().clear();
        pool.install(|| {
            // Batches of one pass and of none; each visit knows the first pass of its batch.
            let batch = |passes, plan| PassBatch { passes, plan };
            let mut starts = (0..passes).map(|pass| batch(1, pass)).take(2).chain([batch(0, 99)]);
            let mut rest = (passes > 2).then(|| batch(passes - 2, 2));
            let next = || starts.next().or_else(|| rest.take());
            let visit = |task: SweepTask, began: &u32| {
                let task = SweepTask { pass: began + task.pass, ..task };
                let needed = needs(interface, &task);
                for s in &needed {
                    assert!(!taken[*s as usize].swap(true, Ordering::AcqRel), "{task:?}");
                }
                let mut rng =
                    Pcg64::seed_from_u64(seed ^ ((task.set as u64) << 32 | u64::from(task.pass)));
                if rng.random_bool(0.2) {
                    std::thread::sleep(std::time::Duration::from_micros(rng.random_range(1..200)));
                }
                seen.lock().unwrap().push(task);
                for s in &needed {
                    taken[*s as usize].store(false, Ordering::Release);
                }
            };
            scheduler.run(interface, visit, next);
        });
    }
    seen.into_inner().unwrap()
}

#[test]
fn sets_that_share_a_subdomain_are_visited_in_the_order_of_barriers() {
    for seed in 0..6 {
        let (subdomains, passes) = ([1, 2, 5, 12, 30, 30][seed as usize], 4);
        let interface = interface(subdomains, 0.3, seed);
        let sets =
            (0..subdomains).chain(interface.colours.items.iter().map(|&g| subdomains + g as usize));
        let sets: Vec<usize> = sets.collect();
        for threads in [1, 2, 3, 8] {
            let seen = record(&interface, passes, threads, seed);
            assert_eq!(seen.len(), sets.len() * passes as usize);
            for s in 0..subdomains as u32 {
                let is_mine = |task: &SweepTask| needs(&interface, task).contains(&s);
                let with_barriers = (0..passes).flat_map(|pass| {
                    sets.iter().map(move |&set| SweepTask {
                        set,
                        is_interface: set >= subdomains,
                        pass,
                    })
                });
                let expected: Vec<SweepTask> = with_barriers.filter(is_mine).collect();
                let found: Vec<SweepTask> = seen.iter().copied().filter(is_mine).collect();
                assert_eq!(found, expected, "seed {seed}, {threads} threads, subdomain {s}");
            }
        }
    }
}

#[test]
fn a_panicking_visit_ends_the_run() {
    let interface = interface(12, 0.5, 1);
    let pool = ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let mut scheduler = SweepScheduler::default();
    for unlucky in [0, 5, 12, 20] {
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.install(|| {
                let visit = |task: SweepTask, _: &()| {
                    // The other threads idle for so long that they park.
                    std::thread::sleep(std::time::Duration::from_millis(2));
                    assert!(task.set != unlucky || task.pass != 1, "unlucky");
                };
                scheduler.run(&interface, visit, once(3));
            });
        }));
        assert!(panicked.is_err());
        // The next run is unaffected.
        let visits = AtomicUsize::new(0);
        pool.install(|| {
            let count = |_: SweepTask, _: &()| {
                visits.fetch_add(1, Ordering::Relaxed);
            };
            scheduler.run(&interface, count, once(2));
        });
        assert_eq!(visits.into_inner(), 2 * (12 + interface.pairs.len()));
    }
}

#[test]
fn a_panic_in_the_choice_of_the_next_batch_ends_the_run() {
    let interface = interface(12, 0.5, 1);
    let pool = ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        pool.install(|| {
            let batch = |passes| Some(PassBatch { passes, plan: () });
            let mut batches = vec![batch(2), batch(1)];
            let next = || batches.pop().expect("unlucky");
            SweepScheduler::default().run(&interface, |_, ()| {}, next);
        });
    }));
    assert!(ended.is_err());
}

#[test]
fn empty_interfaces_missing_pools_and_shared_pools_are_allowed() {
    let visits = AtomicUsize::new(0);
    let count = |_: SweepTask, _: &()| {
        visits.fetch_add(1, Ordering::Relaxed);
    };
    SweepScheduler::default().run(&interface(0, 0.0, 1), count, once(3));
    SweepScheduler::default().run(&interface(5, 0.5, 1), count, once(0));
    assert_eq!(visits.load(Ordering::Relaxed), 0);
    // From outside of any pool, and without an interface.
    SweepScheduler::default().run(&interface(5, 0.0, 1), count, once(3));
    assert_eq!(visits.load(Ordering::Relaxed), 15);

    let (one, other) = (interface(30, 0.3, 2), interface(7, 0.6, 3));
    let pool = ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    pool.install(|| {
        rayon::join(
            || (0..20).for_each(|_| SweepScheduler::default().run(&one, count, once(5))),
            || (0..20).for_each(|_| SweepScheduler::default().run(&other, count, once(5))),
        );
    });
    let sets = 30 + one.pairs.len() + 7 + other.pairs.len();
    assert_eq!(visits.into_inner(), 15 + 20 * 5 * sets);
}

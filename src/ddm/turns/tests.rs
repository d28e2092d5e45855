use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::ThreadPoolBuilder;

/// The interface of so many subdomains, of which each two touch with a probability.
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

/// The subdomains that a turn needs for itself.
fn needs(interface: &Interface, turn: &Turn) -> Vec<u32> {
    match turn.set.checked_sub(interface.groups_by_subdomain.len()) {
        None => vec![turn.set as u32],
        Some(g) => interface.pairs[g].to_vec(),
    }
}

/// One stretch.
fn once(passes: u32) -> impl FnMut() -> Option<Stretch<()>> + Send {
    let mut stretch = Some((passes, ()));
    move || stretch.take()
}

/// All turns of a run in some order in which they ended; passes are counted through its stretches.
fn record(interface: &Interface, passes: u32, threads: usize, seed: u64) -> Vec<Turn> {
    let seen = Mutex::new(Vec::new());
    let taken: Vec<AtomicBool> =
        interface.groups_by_subdomain.starts[1..].iter().map(|_| AtomicBool::new(false)).collect();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut turns = Turns::default();
    // A second run begins where a first one has left off.
    for _ in 0..2 {
        seen.lock().unwrap().clear();
        pool.install(|| {
            // Some stretches of one pass, and some of none; each visit has to know where its stretch began.
            let mut begins = (0..passes).map(|pass| (1, pass)).take(2).chain([(0, 99)]);
            let mut rest = (passes > 2).then_some((passes - 2, 2));
            let next = || begins.next().or_else(|| rest.take());
            let visit = |turn: Turn, began: &u32| {
                let turn = Turn { pass: began + turn.pass, ..turn };
                let needed = needs(interface, &turn);
                for s in &needed {
                    assert!(!taken[*s as usize].swap(true, Ordering::AcqRel), "{turn:?}");
                }
                let mut rng =
                    Pcg64::seed_from_u64(seed ^ ((turn.set as u64) << 32 | u64::from(turn.pass)));
                if rng.random_bool(0.2) {
                    std::thread::sleep(std::time::Duration::from_micros(rng.random_range(1..200)));
                }
                seen.lock().unwrap().push(turn);
                for s in &needed {
                    taken[*s as usize].store(false, Ordering::Release);
                }
            };
            turns.run(interface, visit, next);
        });
    }
    seen.into_inner().unwrap()
}

#[test]
fn what_shares_a_subdomain_has_its_turns_in_the_order_of_barriers() {
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
                let is_mine = |turn: &Turn| needs(&interface, turn).contains(&s);
                let with_barriers = (0..passes).flat_map(|pass| {
                    sets.iter().map(move |&set| Turn { set, of_interface: set >= subdomains, pass })
                });
                let expected: Vec<Turn> = with_barriers.filter(is_mine).collect();
                let found: Vec<Turn> = seen.iter().copied().filter(is_mine).collect();
                assert_eq!(found, expected, "seed {seed}, {threads} threads, subdomain {s}");
            }
        }
    }
}

#[test]
fn nobody_waits_for_a_visit_that_panics() {
    let interface = interface(12, 0.5, 1);
    let pool = ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let mut turns = Turns::default();
    for unlucky in [0, 5, 12, 20] {
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            pool.install(|| {
                let visit = |turn: Turn, _: &()| {
                    // The others have nothing to do for so long that they sleep.
                    std::thread::sleep(std::time::Duration::from_millis(2));
                    assert!(turn.set != unlucky || turn.pass != 1, "unlucky");
                };
                turns.run(&interface, visit, once(3));
            });
        }));
        assert!(panicked.is_err());
        // The next run knows nothing of it.
        let visits = AtomicUsize::new(0);
        pool.install(|| {
            let count = |_: Turn, _: &()| {
                visits.fetch_add(1, Ordering::Relaxed);
            };
            turns.run(&interface, count, once(2));
        });
        assert_eq!(visits.into_inner(), 2 * (12 + interface.pairs.len()));
    }
}

#[test]
fn nobody_waits_for_a_stretch_that_is_never_told() {
    let interface = interface(12, 0.5, 1);
    let pool = ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    let told = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        pool.install(|| {
            let mut stretches = vec![Some((2, ())), Some((1, ()))];
            let next = || stretches.pop().expect("unlucky");
            Turns::default().run(&interface, |_, ()| {}, next);
        });
    }));
    assert!(told.is_err());
}

#[test]
fn there_may_be_nothing_to_do_no_pool_or_others_in_it() {
    let visits = AtomicUsize::new(0);
    let count = |_: Turn, _: &()| {
        visits.fetch_add(1, Ordering::Relaxed);
    };
    Turns::default().run(&interface(0, 0.0, 1), count, once(3));
    Turns::default().run(&interface(5, 0.5, 1), count, once(0));
    assert_eq!(visits.load(Ordering::Relaxed), 0);
    // From outside of any pool, and without an interface.
    Turns::default().run(&interface(5, 0.0, 1), count, once(3));
    assert_eq!(visits.load(Ordering::Relaxed), 15);

    let (one, other) = (interface(30, 0.3, 2), interface(7, 0.6, 3));
    let pool = ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    pool.install(|| {
        rayon::join(
            || (0..20).for_each(|_| Turns::default().run(&one, count, once(5))),
            || (0..20).for_each(|_| Turns::default().run(&other, count, once(5))),
        );
    });
    let sets = 30 + one.pairs.len() + 7 + other.pairs.len();
    assert_eq!(visits.into_inner(), 15 + 20 * 5 * sets);
}

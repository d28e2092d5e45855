use super::*;

/// A box of grains on a lattice, each in contact with its three upper neighbours and the bottom
/// layer with a driven body.
fn lattice(n: [usize; 3]) -> (Vec<Vec3>, Contacts) {
    let number = |i: usize, j: usize, k: usize| ((k * n[1] + j) * n[0] + i) as u32;
    let mut position = Vec::new();
    let mut contacts = Contacts::default();
    let floor = (n[0] * n[1] * n[2]) as u32;
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                let me = number(i, j, k);
                position.push(Vec3::new(i as f64, j as f64, k as f64));
                let mut touch =
                    |other| contacts.push([me, other], 0, Vec3::zeros(), Vec3::z(), 0.0);
                if i + 1 < n[0] {
                    touch(number(i + 1, j, k));
                }
                if j + 1 < n[1] {
                    touch(number(i, j + 1, k));
                }
                if k + 1 < n[2] {
                    touch(number(i, j, k + 1));
                }
                if k == 0 {
                    touch(floor);
                }
            }
        }
    }
    (position, contacts)
}

fn check(partition: &Partition, position: &[Vec3], contacts: &Contacts) {
    let mut seen = vec![0; contacts.len()];
    for s in 0..partition.contacts.len() {
        for &c in partition.contacts.list(s) {
            seen[c as usize] += 1;
            let [a, b] = contacts.bodies[c as usize].map(|x| x as usize);
            assert_eq!(partition.owner[a] as usize, s);
            assert!(b >= position.len() || partition.owner[b] as usize == s);
        }
    }
    let interface = &partition.interface;
    for (g, pair) in interface.pairs.iter().enumerate() {
        for &c in interface.contacts.list(g) {
            seen[c as usize] += 1;
            let mut owners = contacts.bodies[c as usize].map(|b| partition.owner[b as usize]);
            owners.sort_unstable();
            assert_eq!(&owners, pair);
        }
    }
    assert!(seen.iter().all(|&n| n == 1), "each contact belongs to one place");
    let mut groups = 0;
    for colour in 0..interface.colours.len() {
        let mut subdomains: Vec<u32> = interface
            .colours
            .list(colour)
            .iter()
            .flat_map(|&g| interface.pairs[g as usize])
            .collect();
        groups += interface.colours.list(colour).len();
        let all = subdomains.len();
        subdomains.sort_unstable();
        subdomains.dedup();
        assert_eq!(subdomains.len(), all, "groups of a colour share no subdomain");
    }
    assert_eq!(groups, interface.pairs.len());
}

#[test]
fn every_contact_has_one_place_and_colours_are_disjoint() {
    let (position, contacts) = lattice([12, 8, 6]);
    for rule in [
        PartitionRule::Boxes([1, 1, 1]),
        PartitionRule::Boxes([3, 2, 2]),
        PartitionRule::Boxes([7, 1, 1]),
        PartitionRule::Balanced(5),
        PartitionRule::Balanced(16),
        PartitionRule::ContactsPer(100),
        PartitionRule::ContactsPer(1_000_000),
    ] {
        let mut partition = Partition::default();
        partition.divide(rule, &position, &contacts);
        check(&partition, &position, &contacts);
    }
}

#[test]
fn compact_subdomains_are_balanced() {
    let (position, contacts) = lattice([20, 20, 20]);
    let mut partition = Partition::default();
    partition.divide(PartitionRule::Balanced(8), &position, &contacts);
    let sizes: Vec<usize> = (0..8).map(|s| partition.grains.list(s).len()).collect();
    assert!(sizes.iter().all(|&n| n.abs_diff(1000) <= 100), "{sizes:?}");
    let share = partition.interface.contacts.items.len() as f64 / contacts.len() as f64;
    // Three planes of 400 contacts cut the cube into eight: 1 200 of 23 200.
    assert!(share < 0.06, "{share}");
}

#[test]
fn more_subdomains_than_grains_and_no_grains_at_all() {
    let (position, contacts) = lattice([2, 1, 1]);
    let mut partition = Partition::default();
    partition.divide(PartitionRule::Balanced(9), &position, &contacts);
    check(&partition, &position, &contacts);
    partition.divide(PartitionRule::Balanced(3), &[], &Contacts::default());
    assert_eq!(partition.grains.items.len(), 0);
    partition.divide(PartitionRule::Boxes([2, 2, 2]), &[], &Contacts::default());
    check(&partition, &[], &Contacts::default());
}

#[test]
fn one_set_holds_all() {
    let (position, contacts) = lattice([4, 4, 4]);
    let mut partition = Partition::default();
    partition.assign_single_set(position.len(), &contacts);
    check(&partition, &position, &contacts);
    assert_eq!(partition.contacts.list(0).len(), contacts.len());
}
